"""Probabilities from counts of independent runs: exact, approximate and Bayesian intervals."""

import math

from scipy.stats import beta, norm


def clopper_pearson_interval(count: int, total: int, confidence: float = 0.95) -> tuple[float, float]:
    """Two-sided interval of a probability after `count` events in `total` runs (Clopper and Pearson, 1934)."""
    tail = (1.0 - confidence) / 2.0
    low = 0.0 if count == 0 else float(beta.ppf(tail, count, total - count + 1))
    high = 1.0 if count == total else float(beta.ppf(1.0 - tail, count + 1, total - count))
    return low, high


def no_event_bound(total: int, confidence: float = 0.95) -> float:
    """One-sided upper bound of a probability after no event in `total` runs; about 3 / total at 95 %."""
    return -math.expm1(math.log1p(-confidence) / total)


def wilson_interval(count: int, total: int, confidence: float = 0.95) -> tuple[float, float]:
    """Approximate two-sided interval of a probability (Wilson, 1927), narrower than the exact one."""
    z = float(norm.ppf(0.5 + 0.5 * confidence))
    share, weight = count / total, z * z / total
    middle = (share + 0.5 * weight) / (1.0 + weight)
    half = math.sqrt(weight * (share * (1.0 - share) + 0.25 * weight)) / (1.0 + weight)
    return middle - half, middle + half


def jeffreys_interval(count: int, total: int, confidence: float = 0.95) -> tuple[float, float]:
    """Two-sided credible interval of a probability with Jeffreys' prior Beta(1/2, 1/2)."""
    tail = (1.0 - confidence) / 2.0
    low, high = beta.ppf([tail, 1.0 - tail], count + 0.5, total - count + 0.5)
    return float(low), float(high)


def probability_below(limit: float, count: int, total: int) -> float:
    """Posterior probability, with Jeffreys' prior, that the probability of an event is below `limit`."""
    return float(beta.cdf(limit, count + 0.5, total - count + 0.5))
