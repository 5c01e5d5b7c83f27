"""Confidence intervals and bounds of probabilities, quantiles, means and standard deviations.

Sources: Wilks, Annals of Mathematical Statistics 12, 1941; Hanson and Beard, NASA/TP-2010-216447.
"""

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.special import erf
from scipy.stats import beta, binom, bootstrap, chi2

Z_95: Final = 1.96
"""Half-width of the 95 % interval of a standard normal number, rounded as in tables."""
RESAMPLES = 999
_CHUNK = 50
"""Resamples at a time, so that the arrays stay in the cache."""


def coverage_per_axis(sigmas: float) -> float:
    """Probability that a normal error lies within so many of its standard deviations."""
    return float(erf(sigmas / math.sqrt(2.0)))


def clopper_pearson_interval(count: int, total: int, confidence: float = 0.95) -> tuple[float, float]:
    """Two-sided interval of a probability after `count` events in `total` runs (Clopper and Pearson, 1934)."""
    tail = (1.0 - confidence) / 2.0
    low = 0.0 if count == 0 else float(beta.ppf(tail, count, total - count + 1))
    high = 1.0 if count == total else float(beta.ppf(1.0 - tail, count + 1, total - count))
    return low, high


def success_bounds(violations: int, runs: int, risk: float) -> tuple[float, float]:
    """One-sided exact bounds of the probability of success, each wrong with probability `risk`.

    The lower one reaches a requirement's probability exactly where its runs verify it (Clopper and Pearson, 1934).
    """
    low = 0.0 if violations == runs else float(beta.ppf(risk, runs - violations, violations + 1))
    high = 1.0 if violations == 0 else float(beta.ppf(1.0 - risk, runs - violations + 1, violations))
    return low, high


def runs_for_bound(quantile: float, confidence: float, rank: int = 1) -> int:
    """Fewest runs whose `rank`-th largest value is above the quantile with the given confidence (Wilks, one-sided).

    The least n with P(Bin(n, quantile) <= n - rank) >= confidence: with so many runs a requirement on the quantile is
    verified although `rank - 1` of them violate it.
    """
    return _smallest_integer(lambda n: bool(binom.cdf(n - rank, n, quantile) >= confidence), rank)


def _smallest_integer(enough: Callable[[int], bool], low: int) -> int:
    """Smallest integer, at least `low`, for which a condition holds that holds for all greater ones too (bisection)."""
    high = low
    while not enough(high):
        low, high = high + 1, 2 * high
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle + 1, high)
    return high


def allowed_failures(runs: int, probability: float, consumer_risk: float) -> int | None:
    """Most violations in `runs` runs that still verify success in at least `probability`; None if not even zero does.

    The largest k with P(Bin(runs, 1 - probability) <= k) <= consumer_risk (Hanson and Beard). With the runs in order
    from the best to the worst, the one of rank `runs - k` is to be compared with the limit.
    """
    count = int(binom.ppf(consumer_risk, runs, 1.0 - probability))
    # The least count that reaches the risk; unless it meets it exactly, it is one too many.
    if binom.cdf(count, runs, 1.0 - probability) > consumer_risk:
        count -= 1
    return count if count >= 0 else None


def consumer_risk_reached(violations: int, runs: int, probability: float) -> float:
    """Risk of so few violations, or fewer, although success has just less than `probability`."""
    return float(binom.cdf(violations, runs, 1.0 - probability))


def upper_bound_rank(runs: int, quantile: float, confidence: float) -> int | None:
    """Rank (1 = smallest) of the order statistic that is above the quantile with the given confidence.

    Of `runs` independent draws the number below the quantile is binomial, whatever the distribution; the result is the
    smallest r with P(Bin(runs, quantile) <= r - 1) >= confidence, or None where even the largest draw is not enough.
    """
    if runs < 1:
        return None
    rank = int(binom.ppf(confidence, runs, quantile)) + 1
    return rank if rank <= runs else None


def quantile_upper_bound(values: np.ndarray, quantile: float = 0.99, confidence: float = 0.95) -> float | None:
    """One-sided upper confidence bound of a quantile of `values` (n,), in their unit, or None with too few of them."""
    rank = upper_bound_rank(len(values), quantile, confidence)
    return None if rank is None else float(np.sort(values)[rank - 1])


def quantile_interval_ranks(runs: int, quantile: float, confidence: float = 0.95) -> tuple[int | None, int | None]:
    """Ranks (1 = smallest) of the two order statistics that enclose a quantile; None for an end that no run bounds.

    Each side has half of the risk; as ranks are whole numbers, the interval covers the quantile more often than said.
    """
    tail = (1.0 - confidence) / 2.0
    low = int(binom.ppf(tail, runs, quantile))
    return (low if low >= 1 else None), upper_bound_rank(runs, quantile, 1.0 - tail)


def percentiles_over_runs(values: np.ndarray, percents: tuple[float, ...]) -> np.ndarray:
    """Percentiles (len(percents), m) over the runs of `values` (runs, m), leaving out what is not finite.

    Interpolates linearly between ranks as `numpy.percentile` does; NaN where a column holds no finite value.
    """
    ordered = np.sort(np.where(np.isfinite(values), values, np.nan), axis=0)
    position = np.asarray(percents)[:, None] / 100.0 * np.maximum(np.isfinite(ordered).sum(axis=0) - 1, 0)
    below, above = np.floor(position).astype(int), np.ceil(position).astype(int)
    low, high = np.take_along_axis(ordered, below, axis=0), np.take_along_axis(ordered, above, axis=0)
    return low + (position - below) * (high - low)


def mean_interval(values: np.ndarray, resamples: int = 9999) -> tuple[float, float, float]:
    """95 % interval of the mean of `values` (n,) by the bias-corrected accelerated bootstrap, and its standard error.

    Source: Efron, Journal of the American Statistical Association 82, 1987.
    """
    rng = np.random.default_rng(0)
    found = bootstrap((values,), np.mean, n_resamples=resamples, method="BCa", rng=rng, batch=500)
    low, high = found.confidence_interval
    return float(low), float(high), float(found.standard_error)


def deviation_interval(deviation: float, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of the standard deviation of a normal quantity, from the sample's `deviation` over `runs` runs."""
    tail = (1.0 - confidence) / 2.0
    high, low = chi2.ppf([tail, 1.0 - tail], runs - 1)
    return deviation * math.sqrt((runs - 1) / low), deviation * math.sqrt((runs - 1) / high)


def resampled_medians(columns: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Medians (k, 999) of `columns` (k, n) over resampled runs, the same resamples for all columns."""
    count = columns.shape[1]
    # The rank of a resampled median strays from the middle by half a root of n, 1 sigma: only ranks near it matter.
    reach = math.ceil(5.0 * math.sqrt(count))
    window = slice(max(0, count // 2 - reach), count // 2 + reach)
    order = np.argsort(columns, axis=1)
    values = np.take_along_axis(columns, order[:, window], axis=1)
    below_window = np.zeros(columns.shape, dtype=np.float32)
    np.put_along_axis(below_window, order[:, : window.start], np.float32(1.0), axis=1)
    medians: list[np.ndarray] = []
    for start in range(0, RESAMPLES, _CHUNK):
        multiplicity = _multiplicities(min(_CHUNK, RESAMPLES - start), count, rng)
        lower = multiplicity @ below_window.T
        ranks = [lower[:, i, None] + np.cumsum(multiplicity[:, order[i, window]], axis=1) for i in range(len(columns))]
        medians.append(np.stack([_median(row, up_to, count) for row, up_to in zip(values, ranks, strict=True)]))
    return np.concatenate(medians, axis=1)


def _multiplicities(rows: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """How often each of `count` runs is drawn, in each of some resamples (rows, count)."""
    drawn = rng.integers(count, size=(rows, count)) + count * np.arange(rows)[:, None]
    return np.bincount(drawn.ravel(), minlength=rows * count).reshape(rows, count).astype(np.float32)


def _median(values: np.ndarray, up_to: np.ndarray, count: int) -> np.ndarray:
    """Medians (r,) of `count` draws from `values` (w,) in order, `up_to` (r, w) of the draws being at most each."""
    low, high = (np.argmax(up_to > rank, axis=1) for rank in ((count - 1) // 2, count // 2))
    return 0.5 * (values[low] + values[high])


def shrunk_mean(rows: np.ndarray) -> np.ndarray:
    """Mean (k,) of `rows` (n, k), each component times the fraction of its square that its standard error does not
    explain."""
    mean, error = rows.mean(axis=0), rows.std(axis=0, ddof=1) / np.sqrt(len(rows))
    square = mean**2
    return mean * square / np.maximum(square + error**2, 1e-300)
