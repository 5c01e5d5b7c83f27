"""Convergence of estimates and their confidence intervals as runs are added; intervals hold for independent runs."""

from dataclasses import dataclass

import numpy as np

from rpojax.analysis.statistics.intervals import clopper_pearson_interval
from rpojax.analysis.statistics.tolerance_bounds import quantile_interval_ranks, quantile_upper_bound

_SAMPLE_SIZES = 20
_SMALLEST_SAMPLE = 10


@dataclass(frozen=True)
class MetricConvergence:
    """Estimates of a metric over the first `runs` of a campaign, all (c,), NaN where undefined.

    Attributes:
        runs: numbers of runs, evenly spaced on a logarithmic scale
        median: of the runs that have the metric
        median_low: lower end of its exact 95 % interval, from ranks
        median_high: upper end of it
        tail: the 99th percentile of those runs on the bad side
        tail_bound: its one-sided 95 % bound, runs without the metric being worse than all others
    """

    runs: np.ndarray
    median: np.ndarray
    median_low: np.ndarray
    median_high: np.ndarray
    tail: np.ndarray
    tail_bound: np.ndarray


@dataclass(frozen=True)
class RateConvergence:
    """Fraction of runs with an event among the first `runs` of a campaign, with its exact 95 % interval, all (c,)."""

    runs: np.ndarray
    rate: np.ndarray
    low: np.ndarray
    high: np.ndarray


def sample_sizes(runs: int) -> np.ndarray:
    """About twenty numbers of runs, from ten to all, evenly spaced on a logarithmic scale; one for ten and fewer."""
    if runs <= _SMALLEST_SAMPLE:
        return np.array([runs] if runs else [], dtype=np.int64)
    return np.unique(np.round(np.geomspace(_SMALLEST_SAMPLE, runs, _SAMPLE_SIZES)).astype(np.int64))


def metric_convergence(values: np.ndarray, low_is_bad: bool = False) -> MetricConvergence:
    """Convergence of a metric's `values` (n,), NaN where undefined."""
    sizes = sample_sizes(len(values))
    severity = np.where(np.isfinite(values), -values if low_is_bad else values, np.inf)
    rows = np.array([_estimates(severity[:size]) for size in sizes]).reshape(-1, 5)
    median, low, high, tail, bound = -rows.T if low_is_bad else rows.T
    low, high = (high, low) if low_is_bad else (low, high)
    return MetricConvergence(sizes, median, low, high, tail, bound)


def rate_convergence(events: np.ndarray) -> RateConvergence:
    """Convergence of the fraction of runs with an event, of flags (n,)."""
    sizes = sample_sizes(len(events))
    so_far = np.cumsum(events)[sizes - 1]
    ends = [clopper_pearson_interval(int(count), int(size)) for count, size in zip(so_far, sizes, strict=True)]
    low, high = np.array(ends).reshape(-1, 2).T
    return RateConvergence(sizes, so_far / sizes, low, high)


def _estimates(severity: np.ndarray) -> tuple[float, ...]:
    """Median, both ends of its interval, 99th percentile and its bound; infinite values only count in the bound."""
    ranked = np.sort(severity[np.isfinite(severity)])
    if len(ranked) == 0:
        return (np.nan,) * 5
    low, high = quantile_interval_ranks(len(ranked), 0.5)
    bound = quantile_upper_bound(severity)
    return (
        float(np.median(ranked)),
        float(ranked[low - 1]) if low is not None else np.nan,
        float(ranked[high - 1]) if high is not None else np.nan,
        float(np.percentile(ranked, 99.0)),
        bound if bound is not None and np.isfinite(bound) else np.nan,
    )
