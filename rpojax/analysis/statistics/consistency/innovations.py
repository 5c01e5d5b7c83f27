"""Bounds for the innovations of a consistent filter: their normalised square (NIS) and their autocorrelation.

Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4.
"""

import math

from rpojax.analysis.statistics.consistency.nees import mean_nees_interval
from rpojax.analysis.statistics.intervals.normal_distribution import Z_95


def nis_interval(components: int, updates: int = 1, confidence: float = 0.95) -> tuple[float, float]:
    """Interval that holds the mean over `updates` independent updates of the normalised innovation squared (NIS)."""
    return mean_nees_interval(components, updates, confidence)


def whiteness_bound(updates: int) -> float:
    """Size below which the autocorrelation of `updates` white innovations lies in 95 % of the cases."""
    return Z_95 / math.sqrt(updates)
