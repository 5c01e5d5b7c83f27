"""Hilbert-Schmidt independence criterion (HSIC), which also sees dependence that is not monotonic.

Gaussian kernels exp(-d^2 / (2 w^2)) with the median distance of two runs as width w (Gretton et al., 2005).
"""

import math

import numpy as np

from rpojax.analysis.statistics.dependence.multiple_testing import holm_correction

_KERNEL_TOLERANCE = 1e-3
"""Far below the resolution of a thousand runs, and it keeps the factors small."""
_FIRST_PERMUTATIONS = 200
_PROMISING_P = 0.1
"""Inputs with a smaller p-value from the first permutations get as many as the correction needs."""
_LARGEST = 1e100
"""Values beyond it, or differences below its inverse, are scaled."""
_WIDTH_RUNS = 200
"""From about so many runs on, the width of a kernel is taken from a part of them."""


def normalised_hsic(
    inputs: np.ndarray, metric: np.ndarray, level: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Normalised HSIC (k,) of the columns of `inputs` (n, k) with `metric` (n,), and permutation p-values.

    P-values are corrected for k tests; there are enough permutations for the smallest one to fall below `level`.
    """
    factors = [kernel_factor(column, _KERNEL_TOLERANCE).astype(np.float32) for column in inputs.T]
    target = kernel_factor(metric, _KERNEL_TOLERANCE).astype(np.float32)
    sums = np.array([np.sum(np.square(factor.T @ target)) for factor in factors])
    sizes = np.array([np.linalg.norm(factor.T @ factor) for factor in factors])
    p_values = _permutation_p(factors, target, _FIRST_PERMUTATIONS, rng)
    promising = np.flatnonzero(p_values < _PROMISING_P)
    if len(promising):
        # So many that the smallest possible p-value survives the correction.
        permutations = max(_FIRST_PERMUTATIONS, round(1.1 * len(factors) / level))
        p_values[promising] = _permutation_p([factors[index] for index in promising], target, permutations, rng)
    return sums / (sizes * np.linalg.norm(target.T @ target)), holm_correction(p_values)


def kernel_factor(values: np.ndarray, tolerance: float = 1e-12) -> np.ndarray:
    """Centred factor A (n, r) of the kernel of `values` (n,): A A' is H K H to a fraction `tolerance` of its trace.

    Pivoted Cholesky (Fine and Scheinberg, 2001): the kernel of one quantity has few eigenvalues that matter, so r is
    about 10 where n is a thousand.
    """
    values = _in_range(values)
    exponent = -0.5 / _kernel_width(values) ** 2
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


def _in_range(values: np.ndarray) -> np.ndarray:
    """Values of which squares can be formed: the kernel depends on ratios of differences alone, which scaling keeps."""
    values = np.asarray(values, dtype=np.float64)
    largest = float(np.max(np.abs(values), initial=0.0))
    if largest > _LARGEST:
        values = values / largest
    spread = float(np.ptp(values))
    return (values - values[0]) / spread if 0.0 < spread < 1.0 / _LARGEST else values


def _kernel_width(values: np.ndarray) -> float:
    """Median distance of two runs, of some of them where there are many; the mean one where most are equal."""
    some = values[:: max(1, len(values) // _WIDTH_RUNS)]
    distances = np.abs(some[:, None] - some)[np.triu_indices(len(some), 1)]
    return float(np.median(distances)) or float(distances.mean()) or 1.0


def _permutation_p(factors: list[np.ndarray], target: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Fraction (k,) of `count` orders of the runs, the true one among them, with HSIC at least that of the true one.

    All orders and inputs are one matrix product, for which single precision is ample.
    """
    orders = rng.permuted(np.tile(np.arange(len(target)), (count, 1)), axis=1)
    orders[0] = np.arange(len(target))
    products = np.concatenate(factors, axis=1).T @ target[orders.T].reshape(len(target), -1)
    by_row = np.square(products).reshape(len(products), count, -1).sum(axis=2)
    starts = np.cumsum([0, *(factor.shape[1] for factor in factors[:-1])])
    sums = np.add.reduceat(by_row, starts, axis=0)
    return np.mean(sums >= sums[:, :1] * np.float32(1.0 - 1e-5), axis=1)
