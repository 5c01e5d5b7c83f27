"""Intervals of 95 % of figures from images: Wilson's of a fraction, and bootstrap over images."""

from collections.abc import Callable

import numpy as np

_QUANTILE = 1.959964
"""Of the standard normal at 97.5 %."""
_REPLICATES = 200

Interval = tuple[float, float]


def wilson_interval(hits: int, total: int) -> Interval | None:
    """Interval of a fraction of hits (Wilson, 1927); None of nothing."""
    if total == 0:
        return None
    share, square = hits / total, _QUANTILE**2
    center = (share + square / (2 * total)) / (1.0 + square / total)
    half = _QUANTILE * np.sqrt(share * (1.0 - share) / total + square / (4 * total**2)) / (1.0 + square / total)
    return round(float(max(0.0, center - half)), 4), round(float(min(1.0, center + half)), 4)


def bootstrap_interval(statistic: Callable[[np.ndarray], float], images: int, seed: int = 0) -> Interval | None:
    """Interval of a statistic of how often each image (images,) counts; None if a replicate has no finite one.

    The percentile interval of Efron and Tibshirani, "An introduction to the bootstrap", 1993, section 13.3.
    """
    rng = np.random.default_rng(seed)
    draws = [
        statistic(rng.multinomial(images, np.full(images, 1.0 / images)).astype(float)) for _ in range(_REPLICATES)
    ]
    if not np.isfinite(draws).all():
        return None
    low, high = np.quantile(draws, [0.025, 0.975])
    return round(float(low), 4), round(float(high), 4)
