"""Mean of noisy vectors, shrunk towards zero by what its standard error explains."""

import numpy as np


def shrunk_mean(rows: np.ndarray) -> np.ndarray:
    """Mean (k,) of `rows` (n, k), each component times the fraction of its square that its standard error does not
    explain."""
    mean, error = rows.mean(axis=0), rows.std(axis=0, ddof=1) / np.sqrt(len(rows))
    square = mean**2
    return mean * square / np.maximum(square + error**2, 1e-300)
