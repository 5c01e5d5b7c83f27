"""The numbers of a campaign as one dictionary: the content of report.json."""

from typing import Any

import numpy as np

from rpojax.analysis.statistics import quantile_upper_bound
from rpojax.errors import ResultError
from rpojax.report.results import Results
from rpojax.simulation.metrics import UNITS

_CHOOSING_METRIC = "formation_error_rms_m"
_STATISTICS = ("mean", "std", "min", "p50", "p95", "p99", "p99_upper_95", "max")


def summarise(campaign: Results) -> dict[str, Any]:
    """Content of report.json: runs, metrics in their units, requirements, provenance and failures, without NaN."""
    return {
        "runs": _run_counts(campaign),
        "metrics": {name: _metric(name, values) for name, values in campaign.metrics.items()},
        "requirements": [],
        "provenance": plain({key: value for key, value in campaign.info.items() if key != "scenario"}),
        "failures": _failures(campaign),
    }


def choose_run(campaign: Results, run_id: int | None = None) -> int | None:
    """Run to show in detail: `run_id`, else the median one in formation error among kept histories, None without any.

    Raises ResultError where no history of `run_id` is kept.
    """
    kept = sorted(campaign.history_ids)
    if run_id is not None:
        if run_id not in kept:
            listed = ", ".join(map(str, kept[:20])) or "none"
            raise ResultError(f"run {run_id}: found no history, expected one of: {listed}")
        return run_id
    values = campaign.metrics.get(_CHOOSING_METRIC, np.full(len(campaign.completed), np.nan))
    errors = dict(zip(campaign.run_ids.tolist(), values.tolist(), strict=True))
    ranked = sorted((run for run in kept if np.isfinite(errors.get(run, np.nan))), key=lambda run: errors[run])
    if ranked:
        return ranked[(len(ranked) - 1) // 2]
    return kept[0] if kept else None


def plain(value: Any) -> Any:
    """`value` in the types of JSON, with None in place of a number that is not finite."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if isinstance(value, str | int | bool | None) else str(value)


def _run_counts(campaign: Results) -> dict[str, int]:
    completed, known = int(np.sum(campaign.completed)), len(campaign.completed)
    return {"requested": int(campaign.info.get("runs", known)), "completed": completed, "failed": known - completed}


def _metric(name: str, values: np.ndarray) -> dict[str, Any]:
    defined = np.asarray(values, dtype=np.float64)
    defined = defined[np.isfinite(defined)]
    entry: dict[str, Any] = {"unit": UNITS.get(name, "-"), **dict.fromkeys(_STATISTICS), "defined": len(defined)}
    if len(defined) == 0:
        return entry
    p50, p95, p99 = np.percentile(defined, [50, 95, 99])
    entry.update(min=np.min(defined), p50=p50, p95=p95, p99=p99, max=np.max(defined))
    entry.update(mean=np.mean(defined), std=_deviation(defined), p99_upper_95=quantile_upper_bound(defined, 0.99, 0.95))
    return plain(entry)


def _deviation(values: np.ndarray) -> float | None:
    """Sample standard deviation; exactly 0 for equal values, where rounding of the mean would leave a trace."""
    if len(values) < 2:
        return None
    return float(np.std(values, ddof=1)) if np.ptp(values) > 0.0 else 0.0


def _failures(campaign: Results) -> list[dict[str, Any]]:
    return [
        {"run_id": int(run), "at_s": plain(at_s), "reason": str(reason)}
        for run, at_s, reason in zip(campaign.run_ids, campaign.failed_at_s, campaign.failure_reason, strict=True)
        if reason
    ]
