"""The numbers of a campaign as one dictionary: the content of report.json."""

from typing import Any

import numpy as np

from rpojax.analysis.order_statistics import quantile_upper_bound
from rpojax.errors import ResultError
from rpojax.report import faults
from rpojax.report.labels import ordered
from rpojax.report.results import Results
from rpojax.simulation.figures_of_merit import UNITS

_CHOOSING_METRIC = "formation_error_rms_m"
_PERCENTILES = (0.0, 1.0, 5.0, 50.0, 95.0, 99.0, 100.0)
_STATISTICS = ("mean", "std", "min", "p1", "p5", "p50", "p95", "p99", "max", "p1_lower_95", "p99_upper_95")


def summarise(campaign: Results) -> dict[str, Any]:
    """Content of report.json: runs, metrics in their units, requirements, provenance and failures, without NaN."""
    failed = int(np.sum(~np.asarray(campaign.completed, dtype=bool)))
    metrics = campaign.metrics
    return {
        "runs": _run_counts(campaign),
        "metrics": {name: _metric(name, metrics[name], failed) for name in ordered(metrics)},
        "requirements": [],
        "provenance": plain({key: value for key, value in campaign.info.items() if key != "scenario"}),
        "failures": _failures(campaign),
        "faults": faults.counts(campaign),
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
    requested = int(campaign.info.get("runs", known))
    return {
        "requested": requested,
        "completed": completed,
        "failed": known - completed,
        "missing": requested - known,
    }


def _metric(name: str, values: np.ndarray, failed: int) -> dict[str, Any]:
    defined = np.asarray(values, dtype=np.float64)
    defined = defined[np.isfinite(defined)]
    entry: dict[str, Any] = {"unit": UNITS.get(name, "-"), **dict.fromkeys(_STATISTICS), "defined": len(defined)}
    if len(defined) == 0:
        return entry
    names = ("min", "p1", "p5", "p50", "p95", "p99", "max")
    entry.update(zip(names, np.percentile(defined, _PERCENTILES), strict=True))
    entry.update(mean=np.mean(defined), std=_deviation(defined))
    below = _bound(-defined, failed)
    entry.update(p1_lower_95=None if below is None else -below, p99_upper_95=_bound(defined, failed))
    return plain(entry)


def _bound(badness: np.ndarray, failed: int) -> float | None:
    """Upper 95 % bound of the 99th percentile, each failed run being worse than all others; None if it is one."""
    bound = quantile_upper_bound(np.concatenate([badness, np.full(failed, np.inf)]), 0.99, 0.95)
    return bound if bound is not None and np.isfinite(bound) else None


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
