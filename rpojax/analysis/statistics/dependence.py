"""Dependence of a metric on the dispersed inputs: rank correlation, HSIC and two-sample tests.

Hilbert-Schmidt independence criterion (HSIC), which also sees dependence that is not monotonic.

Gaussian kernels exp(-d^2 / (2 w^2)) with the median distance of two runs as width w (Gretton et al., 2005).

Ranking of dispersed inputs by their influence on a metric: rank correlation and HSIC side by side.

No ranking from existing runs is safe alone: rank correlation misses what is not monotonic, and a kernel may rank a
strong input behind a weak one. So there are two, and a flag where their leading inputs differ.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.stats import ks_2samp, mannwhitneyu, rankdata
from scipy.stats import t as student

_KERNEL_TOLERANCE = 1e-3
"""Far below the resolution of a thousand runs, and it keeps the factors small."""
_FIRST_PERMUTATIONS = 200
_PROMISING_P = 0.1
"""Inputs with a smaller p-value from the first permutations get as many as the correction needs."""
_LARGEST = 1e100
"""Values beyond it, or differences below its inverse, are scaled."""
_WIDTH_RUNS = 200
"""Number of runs, about, above which the width of a kernel is taken from a part of them."""
_MAX_EXACT_PAIRS = 10_000
"""Most pairs of two groups that are still compared exactly."""
MIN_RUNS = 10
"""With fewer runs nothing is ranked."""
_LEVEL = 0.05
_LEADING = 3
_HSIC_RUNS = 1000


def spearman(x: np.ndarray, y: np.ndarray) -> float | None:
    """Rank correlation of `x` (n,) and `y` (n,); None if `x` or `y` does not vary."""
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


def holm_correction(p_values: np.ndarray) -> np.ndarray:
    """P-values (n,) of n tests, corrected so that the probability of any false alarm is at most the level.

    Source: Holm, Scandinavian Journal of Statistics 6, 1979.
    """
    order = np.argsort(p_values)
    steps = np.maximum.accumulate(p_values[order] * np.arange(len(p_values), 0, -1))
    corrected = np.empty(len(p_values))
    corrected[order] = np.minimum(steps, 1.0)
    return corrected


def normalised_hsic(
    inputs: np.ndarray, metric: np.ndarray, level: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Normalised HSIC (k,) of the columns of `inputs` (n, k) with `metric` (n,), and permutation p-values.

    P-values are corrected for k tests; there are enough permutations for the smallest one to fall below `level`.
    """
    factors = [_single_factor(np.asarray(column, dtype=np.float64).tobytes()) for column in inputs.T]
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


@lru_cache(maxsize=256)
def _single_factor(values: bytes) -> np.ndarray:
    """Factor of float64 values in single precision; the inputs are the same for every metric."""
    factor = kernel_factor(np.frombuffer(values), _KERNEL_TOLERANCE).astype(np.float32)
    factor.flags.writeable = False
    return factor


def _in_range(values: np.ndarray) -> np.ndarray:
    """Values of which squares can be formed: the kernel depends on ratios of differences alone, which scaling keeps."""
    values = np.asarray(values, dtype=np.float64)
    largest = float(np.max(np.abs(values), initial=0.0))
    if largest > _LARGEST:
        values = values / largest
    spread = float(np.ptp(values))
    return (values - values[0]) / spread if 0.0 < spread < 1.0 / _LARGEST else values


def _kernel_width(values: np.ndarray) -> float:
    """Median distance of two runs, over a sample of many runs; the mean distance where most runs are equal."""
    some = values[:: max(1, len(values) // _WIDTH_RUNS)]
    distances = np.abs(some[:, None] - some)[np.triu_indices(len(some), 1)]
    return float(np.median(distances)) or float(distances.mean()) or 1.0


def _permutation_p(factors: list[np.ndarray], target: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """P-value (k,): fraction of `count` orders of the runs, the true order included, whose HSIC is not smaller.

    All orders and inputs are one matrix product, for which single precision is ample.
    """
    orders = rng.permuted(np.tile(np.arange(len(target)), (count, 1)), axis=1)
    orders[0] = np.arange(len(target))
    products = np.concatenate(factors, axis=1).T @ target[orders.T].reshape(len(target), -1)
    by_row = np.square(products).reshape(len(products), count, -1).sum(axis=2)
    starts = np.cumsum([0, *(factor.shape[1] for factor in factors[:-1])])
    sums = np.add.reduceat(by_row, starts, axis=0)
    return np.mean(sums >= sums[:, :1] * np.float32(1.0 - 1e-5), axis=1)


@dataclass(frozen=True)
class GroupDifference:
    """How a quantity differs between two groups of runs.

    Attributes:
        ks_distance: largest distance of the two distribution functions (Kolmogorov and Smirnov)
        ks_p: its two-sided p-value
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
    exact = pairs <= _MAX_EXACT_PAIRS
    apart = ks_2samp(first, second, method="exact" if exact else "asymp")
    greater = mannwhitneyu(second, first, method="auto" if exact else "asymptotic")
    (distance, distance_p), (count, auc_p) = np.asarray(apart).tolist(), np.asarray(greater).tolist()
    return GroupDifference(distance, distance_p, count / pairs, auc_p)


@dataclass(frozen=True)
class InputInfluence:
    """How a metric depends on one input.

    Attributes:
        name: of the input
        spearman: rank correlation over all runs
        spearman_p: its p-value, corrected for the number of inputs
        hsic: normalised, 0 for independent quantities and 1 for equal ones, over at most 1000 runs
        hsic_p: its permutation p-value, corrected for the number of inputs
    """

    name: str
    spearman: float
    spearman_p: float
    hsic: float
    hsic_p: float


@dataclass(frozen=True)
class InputRanking:
    """Inputs of a metric, those with the greatest rank correlation first.

    Attributes:
        inputs: all that vary
        leading_by_spearman: names of at most three leading inputs whose correlation is significant
        leading_by_hsic: the same by HSIC
        runs: that have the metric
        sampled: of them, for HSIC
    """

    inputs: tuple[InputInfluence, ...]
    leading_by_spearman: tuple[str, ...]
    leading_by_hsic: tuple[str, ...]
    runs: int
    sampled: int

    @property
    def disagree(self) -> bool:
        """True if the two methods name different leading inputs, in whatever order."""
        return set(self.leading_by_spearman) != set(self.leading_by_hsic)


def rank_inputs(inputs: Mapping[str, np.ndarray], metric: np.ndarray, seed: int = 0) -> InputRanking:
    """Ranks `inputs` (runs,) by their influence on `metric` (runs,), leaving out runs without the metric.

    The seed chooses the runs for HSIC and its permutations. Nothing is ranked with fewer than ten runs or where the
    metric does not vary.
    """
    defined = np.isfinite(metric)
    values = metric[defined]
    columns = {name: column[defined] for name, column in inputs.items()}
    names = [name for name, column in columns.items() if len(column) and np.isfinite(column).all() and np.ptp(column)]
    if len(values) < MIN_RUNS or np.ptp(values) == 0.0 or not names:
        return InputRanking((), (), (), len(values), 0)
    rng = np.random.default_rng(seed)
    matrix = np.stack([columns[name] for name in names], axis=1)
    correlation = spearman_columns(matrix, values)
    correlation_p = holm_correction(spearman_p(correlation, len(values)))
    sample = np.sort(rng.permutation(len(values))[:_HSIC_RUNS])
    dependence, dependence_p = normalised_hsic(matrix[sample], values[sample], _LEVEL, rng)
    found = [
        InputInfluence(name, *map(float, numbers))
        for name, *numbers in zip(names, correlation, correlation_p, dependence, dependence_p, strict=True)
    ]
    ranked = sorted(found, key=lambda one: -abs(one.spearman))
    return InputRanking(
        inputs=tuple(ranked),
        leading_by_spearman=_leading(found, lambda one: (abs(one.spearman), one.spearman_p)),
        leading_by_hsic=_leading(found, lambda one: (one.hsic, one.hsic_p)),
        runs=len(values),
        sampled=len(sample),
    )


def _leading(found: list[InputInfluence], score: Callable[[InputInfluence], tuple[float, float]]) -> tuple[str, ...]:
    """Names of the few inputs with the greatest score, its size first, whose p-value is below the level."""
    significant = [one for one in found if score(one)[1] < _LEVEL]
    return tuple(ranked.name for ranked in sorted(significant, key=lambda ranked: -score(ranked)[0])[:_LEADING])
