"""Spearman's rank correlation and its p-value."""

import numpy as np
from scipy.stats import rankdata
from scipy.stats import t as student


def spearman(x: np.ndarray, y: np.ndarray) -> float | None:
    """Rank correlation of `x` (n,) and `y` (n,), or None where one of them does not vary."""
    if len(x) < 2 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return None
    return float(spearman_columns(x[:, None], y)[0])


def spearman_columns(inputs: np.ndarray, metric: np.ndarray) -> np.ndarray:
    """Rank correlation (k,) of each column of `inputs` (n, k) with `metric` (n,), all of which vary."""
    columns, values = rankdata(inputs, axis=0), rankdata(metric)
    columns, values = columns - columns.mean(axis=0), values - values.mean()
    return values @ columns / np.sqrt(np.sum(columns**2, axis=0) * np.sum(values**2))


def spearman_p(correlation: np.ndarray, runs: int) -> np.ndarray:
    """Two-sided p-values of rank correlations of independent quantities over `runs` runs (Student's approximation)."""
    freedom = runs - 2
    squared = np.minimum(np.square(correlation), 1.0)
    with np.errstate(divide="ignore"):
        return 2.0 * student.sf(np.sqrt(freedom * squared / (1.0 - squared)), freedom)
