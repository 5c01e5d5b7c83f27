"""What worst_case.json says of the most likely violation."""

import math
from typing import Any

import numpy as np

from rpojax.analysis.reliability.worst_case import WorstCase
from rpojax.scenario import dispersion_keys
from rpojax.scenario.metric_catalogue import UNITS


def worst_case_json(worst: WorstCase, simulated_value: float) -> dict[str, Any]:
    """What worst_case.json says; `flown` is the metric of the flight that checks it, not a number for a failed run."""
    found, bound, shown = worst.search, worst.limit, worst.reported_point
    broken = not math.isfinite(simulated_value) or bound.is_violated(simulated_value)
    return {
        "scenario": worst.space.file.name,
        "metric": bound.metric,
        "unit": UNITS[bound.metric],
        "bound": bound.bound,
        "limit": bound.limit,
        "seed": worst.seed,
        "run_id": shown.replicate,
        "found": found.nearest_violation is not None,
        "distance_sigmas": shown.distance,
        "probability_first_order": worst.probability,
        "alignment": found.alignment,
        "value": bound.value_at_margin(shown.margin),
        "value_flown": simulated_value,
        "confirmed": found.nearest_violation is not None and broken,
        "dispersions": dispersion_entries(worst),
        "held": list(worst.space.unmapped),
        "cost": _cost(worst),
    }


def dispersion_entries(worst: WorstCase) -> list[dict[str, Any]]:
    """Moved dispersions with their values and sigmas, the farthest from their median first."""
    space, numbers = worst.space, worst.reported_point.z
    entries = []
    for entry in space.mapped:
        name = dispersion_keys.dispersion_name(entry)
        rows = space.slices[name]
        keys = list(dict.fromkeys(place.key for place in dispersion_keys.assigned_keys(entry)))
        entries.append(
            {
                "name": name,
                "kind": entry.kind,
                "distance_sigmas": float(np.linalg.norm(numbers[rows])),
                "sigmas": dict(zip(space.labels[rows], numbers[rows].tolist(), strict=True)),
                "values": {key: worst.values[key].tolist() for key in keys},
                "nominal": {
                    key: dispersion_keys.nominal_value(space.file, dispersion_keys.parse_key(key)) for key in keys
                },
            }
        )
    return sorted(entries, key=lambda each: -each["distance_sigmas"])


def _cost(worst: WorstCase) -> dict[str, Any]:
    found, costs = worst.search, worst.costs
    return {
        "run_equivalents": found.cost,
        "run_equivalents_to_first_violation": None if found.first_violation is None else found.first_violation.cost,
        "flights": found.margin_evaluations,
        "gradients": found.gradient_evaluations,
        "batch": costs.batch_size,
        "flight_s": costs.run_s,
        "gradient_s": costs.gradient_s,
        "gradient_flights": costs.gradient_run_equivalents,
        "compile_s": worst.compile_s,
    }
