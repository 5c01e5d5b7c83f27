"""Statements about a population of independent runs that assume no distribution, and the chi-square test of NEES."""

import numpy as np
from scipy.stats import beta, binom, chi2, rankdata


def upper_bound_rank(runs: int, quantile: float, confidence: float) -> int | None:
    """Rank (1 = smallest) of the order statistic that is above the quantile with the given confidence.

    Of `runs` independent draws the number below the quantile is binomial, whatever the distribution; the result is the
    smallest r with P(Bin(runs, quantile) <= r - 1) >= confidence, or None where even the largest draw is not enough
    (Wilks, Annals of Mathematical Statistics 12, 1941; Hanson and Beard, NASA/TP-2010-216447).
    """
    if runs < 1:
        return None
    rank = int(binom.ppf(confidence, runs, quantile)) + 1
    return rank if rank <= runs else None


def quantile_upper_bound(values: np.ndarray, quantile: float = 0.99, confidence: float = 0.95) -> float | None:
    """One-sided upper confidence bound of a quantile of `values` (n,), in their unit, or None with too few of them."""
    rank = upper_bound_rank(len(values), quantile, confidence)
    return None if rank is None else float(np.sort(values)[rank - 1])


def proportion_interval(count: int, total: int, confidence: float = 0.95) -> tuple[float, float]:
    """Two-sided interval of a probability after `count` events in `total` runs (Clopper and Pearson, 1934)."""
    tail = (1.0 - confidence) / 2.0
    low = 0.0 if count == 0 else float(beta.ppf(tail, count, total - count + 1))
    high = 1.0 if count == total else float(beta.ppf(1.0 - tail, count + 1, total - count))
    return low, high


def mean_nees_interval(components: int, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval that holds the mean NEES of `components` errors over `runs` runs of a consistent filter.

    Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4.2.
    """
    tail = (1.0 - confidence) / 2.0
    low, high = chi2.ppf([tail, 1.0 - tail], components * runs) / runs
    return float(low), float(high)


def rank_correlation(x: np.ndarray, y: np.ndarray) -> float | None:
    """Spearman's rank correlation of `x` (n,) and `y` (n,), or None where one of them does not vary."""
    ranks_x, ranks_y = rankdata(x), rankdata(y)
    if len(x) < 2 or np.ptp(ranks_x) == 0.0 or np.ptp(ranks_y) == 0.0:
        return None
    return float(np.corrcoef(ranks_x, ranks_y)[0, 1])


def percentiles_over_runs(values: np.ndarray, percents: tuple[float, ...]) -> np.ndarray:
    """Percentiles (len(percents), m) over the runs of `values` (runs, m), leaving out what is not finite.

    Interpolates linearly between ranks as `numpy.percentile` does; NaN where a column holds no finite value.
    """
    ordered = np.sort(np.where(np.isfinite(values), values, np.nan), axis=0)
    position = np.asarray(percents)[:, None] / 100.0 * np.maximum(np.isfinite(ordered).sum(axis=0) - 1, 0)
    below, above = np.floor(position).astype(int), np.ceil(position).astype(int)
    low, high = np.take_along_axis(ordered, below, axis=0), np.take_along_axis(ordered, above, axis=0)
    return low + (position - below) * (high - low)
