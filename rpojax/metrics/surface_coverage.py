"""Metrics of inspection coverage: how much of the target's surface was seen, and when."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rpojax.metrics.metric_definition import Floats, Metric

SEEN_FRACTION: Final = "surface_seen_fraction"
TIME_TO_90_PERCENT: Final = "time_to_90_percent_seen_s"
_ENOUGH: Final = 0.9

METRICS: Final = (
    Metric(
        SEEN_FRACTION,
        "-",
        title="Surface seen",
        meaning="Seen area of the target's surface over the area that was lit, both at some time in the run.",
        source="coverage",
        needs="coverage",
        low_is_bad=True,
    ),
    Metric(
        TIME_TO_90_PERCENT,
        "s",
        title="Time to see 90 %",
        meaning="Time until 90 % of the surface that was lit at some time in the run had been seen.",
        source="coverage",
        needs="coverage",
    ),
)


def seen_fraction(areas: Floats, lit: NDArray[np.bool_], seen: NDArray[np.bool_]) -> float:
    """Seen area over lit area of one run, NaN if nothing was lit; all arguments are (facets,)."""
    lit_area = float(np.sum(areas[lit]))
    return float(np.sum(areas[seen])) / lit_area if lit_area > 0.0 else math.nan


def time_to_see(areas: Floats, lit: NDArray[np.bool_], first_seen_s: Floats) -> float:
    """Time until 90 % of the lit area had been seen [s], NaN if it never was.

    Args:
        areas: (facets,)
        lit: (facets,) whether a facet was lit at some time
        first_seen_s: (facets,) when it was first seen, NaN if never
    """
    order = np.argsort(first_seen_s)
    # NaN is sorted to the end, and less than everything is enough if nothing was lit.
    is_enough = np.cumsum(areas[order]) >= _ENOUGH * float(np.sum(areas[lit]))
    enough = np.flatnonzero(is_enough & np.isfinite(first_seen_s[order]))
    return float(first_seen_s[order[enough[0]]]) if len(enough) else math.nan
