"""Bounds of innovations against worked numbers."""

import pytest

from rpojax.analysis.statistics.filter_consistency_intervals import mean_square_interval, whiteness_bound


def test_nis_of_three_components_against_worked_numbers() -> None:
    assert mean_square_interval(3) == pytest.approx((0.215795, 9.348404), abs=5e-7)
    assert mean_square_interval(3, 600) == pytest.approx((2.80718, 3.19913), abs=5e-6)


def test_whiteness_bound_against_a_worked_number() -> None:
    assert whiteness_bound(600) == pytest.approx(0.080017, abs=5e-7)
