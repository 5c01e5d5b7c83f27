"""Spearman's rank correlation against worked numbers and scipy."""

import numpy as np
import pytest
from scipy import stats

from rpojax.analysis.statistics.dependence import spearman, spearman_p

STEPS = np.arange(1.0, 9.0)
SWAPPED = np.array([2.0, 1.0, 4.0, 3.0, 6.0, 5.0, 8.0, 7.0])


def test_rank_correlations_against_worked_numbers() -> None:
    found = spearman(STEPS, SWAPPED)
    assert found == pytest.approx(0.9047619, abs=5e-8)
    assert spearman_p(np.array([found]), 8) == pytest.approx([0.0020083], abs=5e-8)
    assert spearman_p(np.array([1.0, 0.0]), 8) == pytest.approx([0.0, 1.0])


def test_rank_correlation_agrees_with_scipy_with_ties_and_is_none_for_a_constant() -> None:
    rng = np.random.default_rng(2)
    x, y = rng.integers(0, 5, 200), rng.normal(size=200)
    assert spearman(x, y) == pytest.approx(stats.spearmanr(x, y)[0])
    assert spearman(np.ones(9), y[:9]) is None
