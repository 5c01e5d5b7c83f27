"""Bootstrap distribution of a median: runs are drawn anew with replacement (Efron, 1979)."""

import math

import numpy as np

RESAMPLES = 999
_CHUNK = 50
"""Resamples at a time, so that the arrays stay in the cache."""


def resampled_medians(columns: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Medians (k, 999) of `columns` (k, n) over resampled runs, the same resamples for all columns."""
    count = columns.shape[1]
    # The rank of a resampled median strays from the middle by half a root of n, 1 sigma: only ranks near it matter.
    reach = math.ceil(5.0 * math.sqrt(count))
    window = slice(max(0, count // 2 - reach), count // 2 + reach)
    order = np.argsort(columns, axis=1)
    values = np.take_along_axis(columns, order[:, window], axis=1)
    below_window = np.zeros(columns.shape, dtype=np.float32)
    np.put_along_axis(below_window, order[:, : window.start], np.float32(1.0), axis=1)
    medians: list[np.ndarray] = []
    for start in range(0, RESAMPLES, _CHUNK):
        multiplicity = _multiplicities(min(_CHUNK, RESAMPLES - start), count, rng)
        lower = multiplicity @ below_window.T
        ranks = [lower[:, i, None] + np.cumsum(multiplicity[:, order[i, window]], axis=1) for i in range(len(columns))]
        medians.append(np.stack([_median(row, up_to, count) for row, up_to in zip(values, ranks, strict=True)]))
    return np.concatenate(medians, axis=1)


def _multiplicities(rows: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """How often each of `count` runs is drawn, in each of some resamples (rows, count)."""
    drawn = rng.integers(count, size=(rows, count)) + count * np.arange(rows)[:, None]
    return np.bincount(drawn.ravel(), minlength=rows * count).reshape(rows, count).astype(np.float32)


def _median(values: np.ndarray, up_to: np.ndarray, count: int) -> np.ndarray:
    """Medians (r,) of `count` draws from `values` (w,) in order, `up_to` (r, w) of the draws being at most each."""
    low, high = (np.argmax(up_to > rank, axis=1) for rank in ((count - 1) // 2, count // 2))
    return 0.5 * (values[low] + values[high])
