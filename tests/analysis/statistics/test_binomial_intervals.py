"""Intervals of probabilities against worked numbers."""

import pytest
from scipy.stats import binom, binomtest

from rpojax.analysis.statistics.binomial_intervals import (
    clopper_pearson_interval,
    jeffreys_interval,
    no_event_bound,
    probability_below,
    wilson_interval,
)


def test_clopper_pearson_against_worked_numbers() -> None:
    assert clopper_pearson_interval(7, 1000) == pytest.approx((0.0028189, 0.0143692), abs=5e-8)
    assert clopper_pearson_interval(0, 1000) == pytest.approx((0.0, 0.0036821), abs=5e-8)
    assert clopper_pearson_interval(5, 5)[1] == 1.0


def test_at_the_ends_of_the_exact_interval_the_count_is_just_as_rare_as_said() -> None:
    low, high = clopper_pearson_interval(7, 1000, 0.9)
    assert binom.sf(6, 1000, low) == pytest.approx(0.05, rel=1e-9)
    assert binom.cdf(7, 1000, high) == pytest.approx(0.05, rel=1e-9)


def test_bound_without_an_event_against_a_worked_number() -> None:
    assert no_event_bound(1000) == pytest.approx(0.0029912, abs=5e-8)
    assert (1.0 - no_event_bound(40, 0.9)) ** 40 == pytest.approx(0.1, rel=1e-12)


def test_wilson_against_a_worked_number_and_scipy() -> None:
    assert wilson_interval(7, 1000) == pytest.approx((0.0033948, 0.0143783), abs=1e-7)
    other = binomtest(3, 17).proportion_ci(0.9, method="wilson")
    assert wilson_interval(3, 17, 0.9) == pytest.approx((other.low, other.high), rel=1e-9)


def test_jeffreys_against_worked_numbers() -> None:
    assert jeffreys_interval(7, 1000) == pytest.approx((0.0031364, 0.0136945), abs=5e-8)
    assert probability_below(0.01, 3, 1000) == pytest.approx(0.9945911, abs=5e-8)
