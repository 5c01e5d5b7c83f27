"""Intervals of a mean and of a standard deviation against worked numbers."""

import numpy as np
import pytest

from rpojax.analysis.statistics.intervals import deviation_interval, mean_interval


def test_bootstrap_of_a_mean_against_a_worked_number() -> None:
    low, high, error = mean_interval(np.arange(1.0, 21.0))
    assert (low, high) == pytest.approx((7.95, 12.95), abs=1e-9)
    assert error == pytest.approx(1.27741, abs=5e-6)


def test_interval_of_a_standard_deviation_against_a_worked_number() -> None:
    assert deviation_interval(1.0, 1000) == pytest.approx((0.958012, 1.045865), abs=5e-7)
