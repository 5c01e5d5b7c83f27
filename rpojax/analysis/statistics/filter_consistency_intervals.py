"""Consistency of a filter's covariance with its errors: NEES, NIS and whiteness of innovations.

Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from rpojax.analysis.statistics.intervals import Z_95


def mean_square_interval(components: int, count: int = 1, confidence: float = 0.95) -> tuple[float, float]:
    """Interval that holds the mean NEES of `count` runs, or the mean NIS of `count` updates, of a consistent filter."""
    tail = (1.0 - confidence) / 2.0
    low, high = chi2.ppf([tail, 1.0 - tail], components * count) / count
    return float(low), float(high)


@dataclass(frozen=True)
class AverageNees:
    """Average over runs of the NEES, with its chi-square interval.

    Attributes:
        components: of the error
        mean: (ticks,) average over the runs, NaN without any; near `components` for a consistent filter, greater for an
            overconfident one
        low: (ticks,) lower end of its 95 % interval
        high: (ticks,) upper end of its 95 % interval
        fraction_above: of the ticks whose average is above the interval: overconfident
        fraction_below: of the ticks whose average is below the interval: conservative
    """

    components: int
    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray
    fraction_above: float
    fraction_below: float


def average_nees(values: np.ndarray, components: int) -> AverageNees:
    """Average NEES over runs of `values` (runs, ticks), NaN where a run has none."""
    runs = np.isfinite(values).sum(axis=0)
    some = runs > 0
    mean, low, high = np.full((3, values.shape[1]), np.nan)
    mean[some] = np.nansum(values, axis=0)[some] / runs[some]
    low[some], high[some] = chi2.ppf([[0.025], [0.975]], components * runs[some]) / runs[some]
    return AverageNees(components, mean, low, high, _mean(mean[some] > high[some]), _mean(mean[some] < low[some]))


def _mean(flags: np.ndarray) -> float:
    return float(flags.mean()) if len(flags) else math.nan


def whiteness_bound(updates: int) -> float:
    """Size below which the autocorrelation of `updates` white innovations lies in 95 % of the cases."""
    return Z_95 / math.sqrt(updates)
