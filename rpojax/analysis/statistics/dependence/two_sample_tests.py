"""Two-sample tests (Kolmogorov-Smirnov, Mann-Whitney) of which inputs separate failing runs from the others."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import ks_2samp, mannwhitneyu

from rpojax.analysis.statistics.dependence.multiple_testing import holm_correction

_MAX_EXACT_PAIRS = 10_000
"""Two groups with at most so many pairs are compared exactly."""


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


@dataclass(frozen=True)
class InputSeparation:
    """How an input differs between failing and passing runs; p-values corrected for the number of inputs."""

    name: str
    difference: GroupDifference


def group_difference(first: np.ndarray, second: np.ndarray) -> GroupDifference:
    """Compares a quantity in two groups of independent runs (n,) and (m,), none of them empty."""
    pairs = len(first) * len(second)
    exact = pairs <= _MAX_EXACT_PAIRS
    apart = ks_2samp(first, second, method="exact" if exact else "asymp")
    greater = mannwhitneyu(second, first, method="auto" if exact else "asymptotic")
    (distance, distance_p), (count, auc_p) = np.asarray(apart).tolist(), np.asarray(greater).tolist()
    return GroupDifference(distance, distance_p, count / pairs, auc_p)


def separate_failing_runs(inputs: Mapping[str, np.ndarray], failing: np.ndarray) -> tuple[InputSeparation, ...]:
    """Compares `inputs` (runs,) between runs that are `failing` (runs,) and the others, greatest distance first.

    `difference.auc` above one half says that failing runs have the greater values. Empty where all or no runs fail.
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
