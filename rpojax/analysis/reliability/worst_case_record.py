"""What worst_case.json says of the most likely violation."""

import math
from typing import Any

import numpy as np

from rpojax.analysis.reliability.worst_case import Worst
from rpojax.scenario import dispersion_keys
from rpojax.scenario.metric_catalogue import UNITS


def content(worst: Worst, flown: float) -> dict[str, Any]:
    """What worst_case.json says; `flown` is the metric of the flight that checks it, not a number for a failed run."""
    found, bound, shown = worst.found, worst.bound, worst.shown
    broken = not math.isfinite(flown) or bound.broken(flown)
    return {
        "scenario": worst.space.file.name,
        "metric": bound.metric,
        "unit": UNITS[bound.metric],
        "bound": bound.bound,
        "limit": bound.limit,
        "seed": worst.seed,
        "run_id": shown.lane,
        "found": found.nearest is not None,
        "distance_sigmas": shown.distance,
        "probability_first_order": worst.probability,
        "alignment": found.alignment,
        "value": bound.value(shown.margin),
        "value_flown": flown,
        "confirmed": found.nearest is not None and broken,
        "dispersions": dispersions_of(worst),
        "held": list(worst.space.held),
        "cost": _cost(worst),
    }


def dispersions_of(worst: Worst) -> list[dict[str, Any]]:
    """Moved dispersions with their values and sigmas, the farthest from their median first."""
    space, numbers = worst.space, worst.shown.numbers
    entries = []
    for entry in space.moved:
        name = dispersion_keys.name(entry)
        rows = space.slices[name]
        keys = list(dict.fromkeys(place.key for place in dispersion_keys.written(entry)))
        entries.append(
            {
                "name": name,
                "kind": entry.kind,
                "distance_sigmas": float(np.linalg.norm(numbers[rows])),
                "sigmas": dict(zip(space.labels[rows], numbers[rows].tolist(), strict=True)),
                "values": {key: worst.values[key].tolist() for key in keys},
                "nominal": {key: dispersion_keys.nominal(space.file, dispersion_keys.place(key)) for key in keys},
            }
        )
    return sorted(entries, key=lambda each: -each["distance_sigmas"])


def _cost(worst: Worst) -> dict[str, Any]:
    found, costs = worst.found, worst.costs
    return {
        "run_equivalents": found.spent,
        "run_equivalents_to_first_violation": None if found.first is None else found.first.spent,
        "flights": found.margins,
        "gradients": found.gradients,
        "batch": costs.batch,
        "flight_s": costs.flight_s,
        "gradient_s": costs.gradient_s,
        "gradient_flights": costs.gradient_flights,
        "compile_s": worst.compile_s,
    }
