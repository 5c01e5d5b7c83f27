"""How two quantities go together over independent runs: ranks, HSIC, and what sets two groups apart."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import kendalltau, ks_2samp, mannwhitneyu, rankdata
from scipy.stats import t as student

_EXACT_PAIRS = 10_000
"""Two groups with at most so many pairs are compared exactly."""
_FEW = 200
"""From about so many runs on, the width of a kernel is taken from a part of them."""


def spearman(x: np.ndarray, y: np.ndarray) -> float | None:
    """Spearman's rank correlation of `x` (n,) and `y` (n,), or None where one of them does not vary."""
    if len(x) < 2 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return None
    return float(spearman_columns(x[:, None], y)[0])


def spearman_columns(inputs: np.ndarray, metric: np.ndarray) -> np.ndarray:
    """Spearman's rank correlation (k,) of each column of `inputs` (n, k) with `metric` (n,), all of which vary."""
    columns, values = rankdata(inputs, axis=0), rankdata(metric)
    columns, values = columns - columns.mean(axis=0), values - values.mean()
    return values @ columns / np.sqrt(np.sum(columns**2, axis=0) * np.sum(values**2))


def spearman_p(correlation: np.ndarray, runs: int) -> np.ndarray:
    """Two-sided p-values of rank correlations of independent quantities over `runs` runs (Student's approximation)."""
    freedom = runs - 2
    squared = np.minimum(np.square(correlation), 1.0)
    with np.errstate(divide="ignore"):
        return 2.0 * student.sf(np.sqrt(freedom * squared / (1.0 - squared)), freedom)


def kendall_correlation(x: np.ndarray, y: np.ndarray) -> float:
    """Kendall's rank correlation tau-b of `x` (n,) and `y` (n,)."""
    return float(np.asarray(kendalltau(x, y))[0])


def hsic(x: np.ndarray, y: np.ndarray) -> float:
    """Hilbert-Schmidt independence criterion of `x` (n,) and `y` (n,), divided by n^2: 0 for independent quantities.

    Gaussian kernels exp(-d^2 / (2 w^2)) with the median distance of two runs as width w (Gretton et al., 2005).
    """
    return float(np.sum(np.square(kernel_factor(x).T @ kernel_factor(y)))) / len(x) ** 2


def kernel_factor(values: np.ndarray, tolerance: float = 1e-12) -> np.ndarray:
    """Centred factor A (n, r) of the kernel of `values` (n,): A A' is H K H but for a share `tolerance` of its trace.

    Pivoted Cholesky (Fine and Scheinberg, 2001): the kernel of one quantity has few eigenvalues that matter, so r is
    about 10 where n is a thousand.
    """
    exponent = -0.5 / _width(values) ** 2
    left = np.ones(len(values))
    columns: list[np.ndarray] = []
    while left.sum() > tolerance * len(values) and len(columns) < len(values):
        pivot = int(np.argmax(left))
        column = np.exp(exponent * np.square(values - values[pivot]))
        for known in columns:
            column -= known * known[pivot]
        column /= math.sqrt(left[pivot])
        columns.append(column)
        left = np.maximum(left - np.square(column), 0.0)
    factor = np.stack(columns, axis=1)
    return factor - factor.mean(axis=0)


def _width(values: np.ndarray) -> float:
    """Median distance of two runs, of some of them where there are many; the mean one where most are equal."""
    some = values[:: max(1, len(values) // _FEW)]
    distances = np.abs(some[:, None] - some)[np.triu_indices(len(some), 1)]
    return float(np.median(distances)) or float(distances.mean()) or 1.0


@dataclass(frozen=True)
class GroupDifference:
    """How a quantity differs between two groups of runs.

    Attributes:
        distance: largest distance of the two distribution functions (Kolmogorov and Smirnov)
        distance_p: its two-sided p-value
        auc: probability that it is greater in a run of the second group, ties counting half; 0.5 for no difference
        auc_p: its two-sided p-value (Mann and Whitney)
    """

    ks_distance: float
    ks_p: float
    auc: float
    auc_p: float


def group_difference(first: np.ndarray, second: np.ndarray) -> GroupDifference:
    """Compares a quantity in two groups of independent runs (n,) and (m,), none of them empty."""
    pairs = len(first) * len(second)
    exact = pairs <= _EXACT_PAIRS
    apart = ks_2samp(first, second, method="exact" if exact else "asymp")
    greater = mannwhitneyu(second, first, method="auto" if exact else "asymptotic")
    (distance, distance_p), (count, auc_p) = np.asarray(apart).tolist(), np.asarray(greater).tolist()
    return GroupDifference(distance, distance_p, count / pairs, auc_p)
