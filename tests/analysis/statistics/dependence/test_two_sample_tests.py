"""A quantity in two groups of runs compared, against worked numbers."""

import numpy as np
import pytest

from rpojax.analysis.statistics.dependence import group_difference


def test_failing_against_passing_inputs_against_worked_numbers() -> None:
    found = group_difference(np.arange(1.0, 6.0), np.arange(4.0, 9.0))
    assert found.ks_distance == pytest.approx(0.6, rel=1e-12)
    assert found.ks_p == pytest.approx(0.357143, abs=5e-7)
    assert found.auc * 25.0 == pytest.approx(23.0, rel=1e-12)
    assert found.auc_p == pytest.approx(0.035579, abs=5e-7)
