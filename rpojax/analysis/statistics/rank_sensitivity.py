"""Which dispersed quantities a metric depends on, and which ones set failing runs apart from the others.

No ranking from runs already made is safe alone: ranks miss what is not monotonic, and a kernel may rank a strong input
behind a weak one. So there are two, and a flag where they name other leading inputs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import sobol_indices as saltelli
from scipy.stats import uniform

from rpojax.analysis.statistics.dependence_measures import (
    GroupDifference,
    group_difference,
    kernel_factor,
    spearman_columns,
    spearman_p,
)
from rpojax.analysis.statistics.multiple_testing import holm_correction

FEWEST_RUNS = 10
"""With fewer runs nothing is ranked."""
_LEVEL = 0.05
_LEADING = 3
_SAMPLE = 1000
_KERNEL_TOLERANCE = 1e-3
"""Far below what a thousand runs can tell, and it keeps the factors small."""
_FIRST_PERMUTATIONS = 200
_WORTH_A_LOOK = 0.1
"""Inputs with a smaller p-value from the first permutations get as many as it takes to tell."""


@dataclass(frozen=True)
class InputInfluence:
    """How a metric depends on one input.

    Attributes:
        name: of the input
        correlation: Spearman's, over all runs
        correlation_p: its p-value, corrected for the number of inputs
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
        by_correlation: names of at most three leading inputs whose correlation is beyond chance
        by_hsic: the same by HSIC
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

    The seed chooses the runs that HSIC looks at and its permutations. Nothing is ranked with fewer than ten runs or
    where the metric does not vary.
    """
    defined = np.isfinite(metric)
    values = metric[defined]
    columns = {name: column[defined] for name, column in inputs.items()}
    names = [name for name, column in columns.items() if len(column) and np.isfinite(column).all() and np.ptp(column)]
    if len(values) < FEWEST_RUNS or np.ptp(values) == 0.0 or not names:
        return InputRanking((), (), (), len(values), 0)
    rng = np.random.default_rng(seed)
    matrix = np.stack([columns[name] for name in names], axis=1)
    correlation = spearman_columns(matrix, values)
    correlation_p = holm_correction(spearman_p(correlation, len(values)))
    sample = np.sort(rng.permutation(len(values))[:_SAMPLE])
    dependence, dependence_p = _dependence(matrix[sample], values[sample], rng)
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
    beyond_chance = [one for one in found if score(one)[1] < _LEVEL]
    return tuple(one.name for one in sorted(beyond_chance, key=lambda one: -score(one)[0])[:_LEADING])


def _dependence(inputs: np.ndarray, metric: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Normalised HSIC (k,) of the columns of `inputs` (n, k) with `metric` (n,), and corrected p-values."""
    factors = [kernel_factor(column, _KERNEL_TOLERANCE).astype(np.float32) for column in inputs.T]
    target = kernel_factor(metric, _KERNEL_TOLERANCE).astype(np.float32)
    sums = np.array([np.sum(np.square(factor.T @ target)) for factor in factors])
    sizes = np.array([np.linalg.norm(factor.T @ factor) for factor in factors])
    p_values = _permuted(factors, target, _FIRST_PERMUTATIONS, rng)
    promising = np.flatnonzero(p_values < _WORTH_A_LOOK)
    if len(promising):
        # So many that the smallest p-value there can be survives the correction.
        permutations = max(_FIRST_PERMUTATIONS, round(1.1 * len(factors) / _LEVEL))
        p_values[promising] = _permuted([factors[index] for index in promising], target, permutations, rng)
    return sums / (sizes * np.linalg.norm(target.T @ target)), holm_correction(p_values)


def _permuted(factors: list[np.ndarray], target: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Share (k,) of `count` orders of the runs, the true one among them, in which HSIC is at least the true one.

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
class InputSeparation:
    """How an input differs between failing and passing runs; p-values corrected for the number of inputs."""

    name: str
    difference: GroupDifference


def separate_failing_runs(inputs: Mapping[str, np.ndarray], failing: np.ndarray) -> tuple[InputSeparation, ...]:
    """Compares `inputs` (runs,) between runs that are `failing` (runs,) and the others, those most apart first.

    `contrast.auc` above one half says that failing runs have the greater values. Empty where all or no runs fail.
    """
    if failing.all() or not failing.any():
        return ()
    names = [name for name, column in inputs.items() if np.isfinite(column).all() and np.ptp(column) > 0.0]
    found = [group_difference(inputs[name][~failing], inputs[name][failing]) for name in names]
    distance_p = holm_correction(np.array([one.ks_p for one in found]))
    auc_p = holm_correction(np.array([one.auc_p for one in found]))
    corrected = [
        InputSeparation(name, GroupDifference(one.ks_distance, float(by_distance), one.auc, float(by_auc)))
        for name, one, by_distance, by_auc in zip(names, found, distance_p, auc_p, strict=True)
    ]
    return tuple(sorted(corrected, key=lambda one: -one.difference.ks_distance))


@dataclass(frozen=True)
class SobolIndices:
    """Shares of a function's variance: (k,) of each input alone, and with all that it takes part in."""

    first_order: np.ndarray
    total_order: np.ndarray


def sobol_indices(
    function: Callable[[np.ndarray], np.ndarray], low: np.ndarray, high: np.ndarray, runs: int, seed: int = 0
) -> SobolIndices:
    """Sobol indices of `function`, points (n, k) -> values (n,), for inputs uniform from `low` to `high` (k,).

    Calls it at `runs` (k + 2) points, `runs` a power of two (Saltelli et al., Comput. Phys. Commun. 181, 2010).
    """
    found = saltelli(
        func=lambda points: np.asarray(function(points.T))[None, :],
        n=runs,
        dists=[uniform(loc=start, scale=end - start) for start, end in zip(low, high, strict=True)],
        rng=np.random.default_rng(seed),
    )
    return SobolIndices(np.ravel(found.first_order), np.ravel(found.total_order))
