"""Clopper-Pearson intervals against worked numbers and the binomial distribution."""

import pytest
from scipy.stats import binom

from rpojax.analysis.statistics.intervals import clopper_pearson_interval, success_bounds


def test_clopper_pearson_against_worked_numbers() -> None:
    assert clopper_pearson_interval(7, 1000) == pytest.approx((0.0028189, 0.0143692), abs=5e-8)
    assert clopper_pearson_interval(0, 1000) == pytest.approx((0.0, 0.0036821), abs=5e-8)
    assert clopper_pearson_interval(5, 5)[1] == 1.0


def test_at_the_ends_of_the_exact_interval_the_count_has_the_stated_tail_probability() -> None:
    low, high = clopper_pearson_interval(7, 1000, 0.9)
    assert binom.sf(6, 1000, low) == pytest.approx(0.05, rel=1e-9)
    assert binom.cdf(7, 1000, high) == pytest.approx(0.05, rel=1e-9)


def test_the_bounds_of_success_have_the_stated_risk() -> None:
    low, high = success_bounds(3, 200, 0.1)
    assert binom.cdf(3, 200, 1.0 - low) == pytest.approx(0.1, rel=1e-9)
    assert binom.sf(2, 200, 1.0 - high) == pytest.approx(0.1, rel=1e-9)
    assert success_bounds(0, 50, 0.1)[1] == 1.0
    assert success_bounds(50, 50, 0.1)[0] == 0.0
