"""Bounds of quantiles by order statistics, and the numbers of runs and of violations that verify a requirement.

Sources: Wilks, Annals of Mathematical Statistics 12, 1941; Hanson and Beard, NASA/TP-2010-216447.
"""

from collections.abc import Callable

import numpy as np
from scipy.stats import binom


def runs_for_bound(quantile: float, confidence: float, rank: int = 1) -> int:
    """Fewest runs whose `rank`-th largest value is above the quantile with the given confidence (Wilks, one-sided).

    The least n with P(Bin(n, quantile) <= n - rank) >= confidence: with this many runs a requirement on the quantile
    is verified even if `rank - 1` of them violate it.
    """
    return _smallest_integer(lambda n: bool(binom.cdf(n - rank, n, quantile) >= confidence), rank)


def _smallest_integer(enough: Callable[[int], bool], low: int) -> int:
    """Smallest integer from `low` on that meets a condition, which all larger integers must meet too (bisection)."""
    high = low
    while not enough(high):
        low, high = high + 1, 2 * high
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle + 1, high)
    return high


def allowed_failures(runs: int, probability: float, consumer_risk: float) -> int | None:
    """Largest number of violations in `runs` runs that verifies a probability of success; None if even zero do not.

    The largest k with P(Bin(runs, 1 - probability) <= k) <= consumer_risk (Hanson and Beard). With the runs in order
    from the best to the worst, the one of rank `runs - k` is to be compared with the limit.
    """
    count = int(binom.ppf(consumer_risk, runs, 1.0 - probability))
    # `count` is the smallest one whose probability reaches the risk; unless it equals the risk, it is one too many.
    if binom.cdf(count, runs, 1.0 - probability) > consumer_risk:
        count -= 1
    return count if count >= 0 else None


def consumer_risk_reached(violations: int, runs: int, probability: float) -> float:
    """Probability of at most `violations` violations if the probability of success is just below `probability`."""
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

    Each side has half of the risk; as ranks are whole numbers, the interval covers the quantile more often than stated.
    """
    tail = (1.0 - confidence) / 2.0
    low = int(binom.ppf(tail, runs, quantile))
    return (low if low >= 1 else None), upper_bound_rank(runs, quantile, 1.0 - tail)
