"""What was dispersed, as drawn, and how the metrics follow it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.analysis.dependence import rank_correlation
from rpojax.report.charts import binned, compact
from rpojax.report.labels import metric, number, ordered
from rpojax.report.results import Results

_FEWEST_RUNS = 10
_MOST_POINTS = 1500


@dataclass(frozen=True)
class Dispersion:
    """One dispersed scalar over all runs, in the unit of its key, and what the scenario says of it.

    `nominal` and `declared` are texts, empty where the scenario is silent; `bars` are bin heights from 0 to 1.
    """

    key: str
    nominal: str
    declared: str
    mean: float
    std: float | None
    minimum: float
    maximum: float
    bars: list[float]


def scalars(campaign: Results) -> dict[str, np.ndarray]:
    """Every dispersed scalar (runs,): a vector gives one entry per component, named `key[0]`, `key[1]`, ..."""
    found: dict[str, np.ndarray] = {}
    for key, values in campaign.drawn.items():
        rows = np.asarray(values, dtype=np.float64)
        columns = rows.reshape(len(rows), -1).T
        names = [key] if rows.ndim == 1 else [f"{key}[{index}]" for index in range(len(columns))]
        found.update(zip(names, columns, strict=True))
    return found


def as_drawn(campaign: Results) -> list[Dispersion]:
    """Mean, standard deviation, extremes and shape of every dispersed scalar, in drawing order."""
    scenario = campaign.info.get("scenario", {})
    found = {key: values[np.isfinite(values)] for key, values in scalars(campaign).items()}
    return [_describe(scenario, key, values) for key, values in found.items() if len(values)]


def explorer(campaign: Results) -> dict[str, Any] | None:
    """Data for scatter plots of each metric against each dispersed scalar, None with too few runs or nothing dispersed.

    Holds the values of at most 1500 runs (the first ones, which are as random as any), the rank correlation of each
    pair over all runs, and the size below which a correlation of independent quantities lies in 95 % of the cases.
    """
    inputs = {key: values for key, values in scalars(campaign).items() if np.ptp(values) > 0.0}
    found = campaign.metrics
    metrics = {name: found[name] for name in ordered(found) if _varies(found[name])}
    if not inputs or not metrics:
        return None
    return {
        "runs": campaign.run_ids[:_MOST_POINTS].tolist(),
        "metrics": {
            name: {
                "title": metric(name).title,
                "unit": metric(name).unit,
                "values": compact(values[:_MOST_POINTS]),
                "rank": _ranks(values, inputs),
                "chance": round(1.96 / float(np.sqrt(np.isfinite(values).sum() - 1)), 4),
            }
            for name, values in metrics.items()
        },
        "inputs": {key: compact(values[:_MOST_POINTS]) for key, values in inputs.items()},
    }


def _varies(values: np.ndarray) -> bool:
    defined = values[np.isfinite(values)]
    return len(defined) >= _FEWEST_RUNS and float(np.ptp(defined)) > 0.0


def _ranks(values: np.ndarray, inputs: dict[str, np.ndarray]) -> dict[str, float]:
    defined = np.isfinite(values)
    found = {key: rank_correlation(drawn[defined], values[defined]) for key, drawn in inputs.items()}
    return {key: round(rank, 4) for key, rank in found.items() if rank is not None}


def _describe(scenario: Mapping[str, Any], key: str, values: np.ndarray) -> Dispersion:
    counts, _ = binned(values)
    return Dispersion(
        key=key,
        nominal=_nominal(scenario, key),
        declared=_declared(scenario, key),
        mean=float(values.mean()),
        std=float(values.std(ddof=1)) if len(values) > 1 else None,
        minimum=float(values.min()),
        maximum=float(values.max()),
        bars=[round(float(count), 3) for count in counts / counts.max()],
    )


def _nominal(scenario: Mapping[str, Any], key: str) -> str:
    path, _, component = key.partition("[")
    value: Any = scenario
    for part in path.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    if component and isinstance(value, list):
        value = value[int(component.rstrip("]"))]
    return number(float(value)) if isinstance(value, int | float) else ""


def _declared(scenario: Mapping[str, Any], key: str) -> str:
    """What a scenario says of a dispersed number: of its key as a whole, or of the component itself."""
    names = {key, key.partition("[")[0]}
    for entry in scenario.get("dispersions", []):
        if names & {entry.get("key"), *entry.get("keys", [])}:
            rest = ", ".join(f"{name} {value}" for name, value in entry.items() if name not in ("key", "keys", "kind"))
            return f"{entry.get('kind', '')} {rest}".strip()
    design = scenario.get("design", {})
    return str(design["kind"]) if names & set(design.get("values", {})) else ""
