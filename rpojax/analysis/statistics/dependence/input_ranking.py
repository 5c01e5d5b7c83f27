"""Ranking of dispersed inputs by their influence on a metric: rank correlation and HSIC side by side.

No ranking from existing runs is safe alone: rank correlation misses what is not monotonic, and a kernel may rank a
strong input behind a weak one. So there are two, and a flag where their leading inputs differ.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from rpojax.analysis.statistics.dependence.hsic import normalised_hsic
from rpojax.analysis.statistics.dependence.multiple_testing import holm_correction
from rpojax.analysis.statistics.dependence.rank_correlation import spearman_columns, spearman_p

MIN_RUNS = 10
"""With fewer runs nothing is ranked."""
_LEVEL = 0.05
_LEADING = 3
_HSIC_RUNS = 1000


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
    return tuple(one.name for one in sorted(significant, key=lambda one: -score(one)[0])[:_LEADING])
