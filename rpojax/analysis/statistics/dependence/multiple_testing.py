"""Correction of p-values for many tests at once."""

import numpy as np


def holm_correction(p_values: np.ndarray) -> np.ndarray:
    """P-values (n,) of n tests, corrected so that the probability of any false alarm is at most the level.

    Source: Holm, Scandinavian Journal of Statistics 6, 1979.
    """
    order = np.argsort(p_values)
    steps = np.maximum.accumulate(p_values[order] * np.arange(len(p_values), 0, -1))
    corrected = np.empty(len(p_values))
    corrected[order] = np.minimum(steps, 1.0)
    return corrected
