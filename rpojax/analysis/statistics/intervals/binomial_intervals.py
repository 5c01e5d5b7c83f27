"""Exact confidence intervals of a probability from counted events (Clopper-Pearson)."""

from scipy.stats import beta


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
