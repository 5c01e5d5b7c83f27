"""Ends of an axis that a few runs far away do not stretch until all others are one line."""

from collections.abc import Sequence
from typing import Final

import numpy as np

_FAR: Final = 4.0
"""Spans of the middle 80 % of values beyond which the scale of an axis does not follow a few of them."""
_MOST_BEYOND: Final = 0.1
"""Largest share of values that the scale of an axis leaves out."""
_DECADES_FACTOR: Final = 20.0
"""Ratio of the largest to the middle value from which an axis of positive values is logarithmic."""


def axis_ends(values: np.ndarray, limits: Sequence[float] = ()) -> tuple[float, float]:
    """Ends of an axis: of all values and limits, or without the few that are far beyond the others."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return (min(limits), max(limits)) if limits else (0.0, 1.0)
    low, high = np.percentile(finite, (100.0 * _MOST_BEYOND, 100.0 * (1.0 - _MOST_BEYOND)))
    reach = _FAR * (high - low)
    shown = finite[(finite >= low - reach) & (finite <= high + reach)] if reach > 0.0 else finite
    if len(shown) < (1.0 - _MOST_BEYOND) * len(finite):
        shown = finite
    ends = np.concatenate([shown, limits])
    return float(ends.min()), float(ends.max())


def spans_decades(values: np.ndarray) -> bool:
    """Whether positive values reach so far beyond their middle that a linear axis would hide most of them."""
    finite = values[np.isfinite(values)]
    if not len(finite) or float(finite.min()) <= 0.0:
        return False
    return float(finite.max()) > _DECADES_FACTOR * float(np.median(finite))
