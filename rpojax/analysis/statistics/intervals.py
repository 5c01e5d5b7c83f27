"""Confidence intervals of probabilities, means, medians and standard deviations, and percentiles over runs."""

import math
from typing import Final

import numpy as np
from scipy.special import erf
from scipy.stats import beta, bootstrap, chi2

Z_95: Final = 1.96
"""Half-width of the 95 % interval of a standard normal number, rounded as in tables."""
RESAMPLES = 999
_CHUNK = 50
"""Resamples at a time, so that the arrays stay in the cache."""


def coverage_per_axis(sigmas: float) -> float:
    """Probability that a normal error lies within `sigmas` of its standard deviations."""
    return float(erf(sigmas / math.sqrt(2.0)))


def clopper_pearson_interval(count: int, total: int, confidence: float = 0.95) -> tuple[float, float]:
    """Two-sided interval of a probability after `count` events in `total` runs (Clopper and Pearson, 1934)."""
    tail = (1.0 - confidence) / 2.0
    low = 0.0 if count == 0 else float(beta.ppf(tail, count, total - count + 1))
    high = 1.0 if count == total else float(beta.ppf(1.0 - tail, count + 1, total - count))
    return low, high


def success_bounds(violations: int, runs: int, risk: float) -> tuple[float, float]:
    """One-sided exact bounds of the probability of success, each wrong with probability `risk`.

    The lower bound reaches the required probability exactly when the runs verify the requirement (Clopper and Pearson,
    1934).
    """
    low = 0.0 if violations == runs else float(beta.ppf(risk, runs - violations, violations + 1))
    high = 1.0 if violations == 0 else float(beta.ppf(1.0 - risk, runs - violations + 1, violations))
    return low, high


def percentiles_over_runs(values: np.ndarray, percents: tuple[float, ...]) -> np.ndarray:
    """Percentiles (len(percents), m) over the runs of `values` (runs, m), ignoring non-finite values.

    Interpolates linearly between ranks as `numpy.percentile` does; NaN where a column holds no finite value.
    """
    ordered = np.sort(np.where(np.isfinite(values), values, np.nan), axis=0)
    position = np.asarray(percents)[:, None] / 100.0 * np.maximum(np.isfinite(ordered).sum(axis=0) - 1, 0)
    below, above = np.floor(position).astype(int), np.ceil(position).astype(int)
    low, high = np.take_along_axis(ordered, below, axis=0), np.take_along_axis(ordered, above, axis=0)
    return low + (position - below) * (high - low)


def mean_interval(values: np.ndarray, resamples: int = 9999) -> tuple[float, float, float]:
    """95 % interval of the mean of `values` (n,) by the bias-corrected accelerated bootstrap, and its standard error.

    Source: Efron, Journal of the American Statistical Association 82, 1987.
    """
    rng = np.random.default_rng(0)
    found = bootstrap((values,), np.mean, n_resamples=resamples, method="BCa", rng=rng, batch=500)
    low, high = found.confidence_interval
    return float(low), float(high), float(found.standard_error)


def deviation_interval(deviation: float, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of the standard deviation of a normal quantity, from the sample's `deviation` over `runs` runs."""
    tail = (1.0 - confidence) / 2.0
    high, low = chi2.ppf([tail, 1.0 - tail], runs - 1)
    return deviation * math.sqrt((runs - 1) / low), deviation * math.sqrt((runs - 1) / high)


def resampled_medians(columns: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Medians (k, 999) of `columns` (k, n) over resampled runs, the same resamples for all columns."""
    count = columns.shape[1]
    # The rank of a resampled median has the deviation sqrt(n) / 2 (1 sigma) from the middle: only ranks near it matter.
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
    """Medians (r,) of `count` draws from `values` (w,) in order, `up_to` (r, w) is how many are at most each."""
    low, high = (np.argmax(up_to > rank, axis=1) for rank in ((count - 1) // 2, count // 2))
    return 0.5 * (values[low] + values[high])


def shrunk_mean(rows: np.ndarray) -> np.ndarray:
    """Mean (k,) of `rows` (n, k), each component m with standard error s scaled by m^2 / (m^2 + s^2)."""
    mean, error = rows.mean(axis=0), rows.std(axis=0, ddof=1) / np.sqrt(len(rows))
    square = mean**2
    return mean * square / np.maximum(square + error**2, 1e-300)
