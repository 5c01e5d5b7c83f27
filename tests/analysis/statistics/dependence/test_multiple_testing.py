"""Holm's correction against a worked example."""

import numpy as np
import pytest

from rpojax.analysis.statistics.dependence import holm_correction


def test_holms_correction_against_a_worked_example() -> None:
    # Sorted .005, .01, .03, .04 times 4, 3, 2, 1, never falling: .02, .03, .06, .06.
    assert holm_correction(np.array([0.01, 0.04, 0.03, 0.005])).tolist() == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm_correction(np.array([0.9, 0.8])).tolist() == [1.0, 1.0]
