"""Statistics of one metric over runs, with confidence intervals."""

from functools import lru_cache
from typing import Any

import numpy as np

from rpojax.analysis.statistics.intervals import Z_95, deviation_interval, mean_interval
from rpojax.analysis.statistics.tolerance_bounds import quantile_interval_ranks, quantile_upper_bound
from rpojax.metrics.metric_catalogue import unit_of

_PERCENTILES = {"min": 0.0, "p1": 1.0, "p5": 5.0, "p50": 50.0, "p95": 95.0, "p99": 99.0, "max": 100.0}
_QUANTILES = ("p1", "p5", "p50", "p95", "p99")
_STATISTIC_NAMES = (
    *("mean", "std", *_PERCENTILES, "p1_lower_95", "p99_upper_95", "mean_interval_95", "mean_interval_method"),
    *("std_interval_95", *(f"{name}_interval_95" for name in _QUANTILES)),
)
MIN_RUNS = 10
"""With fewer runs, mean and standard deviation have no interval."""
_MAX_RESAMPLED_RUNS = 500
"""With more runs the mean is close to normal and is not resampled."""
_RESAMPLES = 1999


def summary_statistics(name: str, values: np.ndarray, independent: bool) -> dict[str, Any]:
    """Statistics of a metric's `values` (runs,), None where undefined; intervals are 95 % and need independent runs.

    For the bounds of p99 and p1 a run without a value, failed or not, counts as worse than all others; a bound is None
    if it would be such a run. Intervals of quantiles are from order statistics, None at an end that no run bounds; that
    of the standard deviation assumes a normal distribution.
    """
    defined = np.asarray(values, dtype=np.float64)
    defined = defined[np.isfinite(defined)]
    entry: dict[str, Any] = {"unit": unit_of(name), **dict.fromkeys(_STATISTIC_NAMES), "defined": len(defined)}
    if len(defined) == 0:
        return entry
    entry |= dict(zip(_PERCENTILES, np.percentile(defined, list(_PERCENTILES.values())).tolist(), strict=True))
    entry |= {"mean": float(np.mean(defined)), "std": _standard_deviation(defined)}
    return entry | _intervals(defined, len(values) - len(defined), entry["std"]) if independent else entry


def mean_confidence_interval(values: np.ndarray) -> tuple[list[float], str] | None:
    """95 % interval of the mean of independent, finite `values` (n,), and name of the method; None for few runs.

    Bootstrap (BCa) up to 500 runs, then the normal approximation.
    """
    if len(values) < MIN_RUNS:
        return None
    if np.ptp(values) == 0.0:
        return [float(values[0])] * 2, "all runs agree"
    if len(values) <= _MAX_RESAMPLED_RUNS:
        low, high = _resampled_mean_interval(np.asarray(values, dtype=np.float64).tobytes())
        if np.isfinite(low) and np.isfinite(high):
            return [low, high], "bootstrap (BCa)"
    half = Z_95 * float(np.std(values, ddof=1)) / float(np.sqrt(len(values)))
    return [float(np.mean(values)) - half, float(np.mean(values)) + half], "normal"


@lru_cache(maxsize=256)
def _resampled_mean_interval(values: bytes) -> tuple[float, float]:
    """Interval of the mean of float64 values: a report asks for it after the table in the terminal has."""
    low, high, _ = mean_interval(np.frombuffer(values), resamples=_RESAMPLES)
    return low, high


def _intervals(defined: np.ndarray, undefined: int, deviation: float | None) -> dict[str, Any]:
    below = _p99_upper_bound(-defined, undefined)
    found: dict[str, Any] = {
        "p1_lower_95": None if below is None else -below,
        "p99_upper_95": _p99_upper_bound(defined, undefined),
    }
    of_mean = mean_confidence_interval(defined)
    if of_mean is not None and deviation is not None:
        found |= {"mean_interval_95": of_mean[0], "mean_interval_method": of_mean[1]}
        found["std_interval_95"] = list(deviation_interval(deviation, len(defined)))
    ranked = np.sort(defined)
    for name in _QUANTILES:
        ranks = quantile_interval_ranks(len(ranked), _PERCENTILES[name] / 100.0)
        found[f"{name}_interval_95"] = [None if rank is None else float(ranked[rank - 1]) for rank in ranks]
    return found


def _p99_upper_bound(badness: np.ndarray, undefined: int) -> float | None:
    """Upper 95 % bound of the 99th percentile of badness (n,), undefined runs being worst; None if it is infinite."""
    bound = quantile_upper_bound(np.concatenate([badness, np.full(undefined, np.inf)]), 0.99, 0.95)
    return bound if bound is not None and np.isfinite(bound) else None


def _standard_deviation(values: np.ndarray) -> float | None:
    """Sample standard deviation; exactly 0 for equal values, where rounding of the mean would leave a residual."""
    if len(values) < 2:
        return None
    return float(np.std(values, ddof=1)) if np.ptp(values) > 0.0 else 0.0
