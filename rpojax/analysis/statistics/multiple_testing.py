"""What chance alone does: the convention for 95 % and the correction for many tests at once."""

from typing import Final

import numpy as np

Z_95: Final = 1.96
"""Half-width of the 95 % interval of a standard normal number, as tables and textbooks round it."""


def holm_correction(p_values: np.ndarray) -> np.ndarray:
    """P-values (n,) of n tests, corrected so that the chance of any false alarm among them is at most the level.

    Source: Holm, Scandinavian Journal of Statistics 6, 1979.
    """
    order = np.argsort(p_values)
    steps = np.maximum.accumulate(p_values[order] * np.arange(len(p_values), 0, -1))
    corrected = np.empty(len(p_values))
    corrected[order] = np.minimum(steps, 1.0)
    return corrected
