"""Precision of estimates and numbers of runs against worked numbers, tables and the variance of simple plans."""

import math

import numpy as np
import pytest

from rpojax.analysis.statistics.multiple_testing import holm_correction
from rpojax.analysis.statistics.sampling_precision import (
    Plan,
    deviation_interval,
    deviation_of_mean,
    effective_sample_size,
    mean_interval,
    normal_tolerance_factor,
    relative_error_of_rate,
    runs_for_half_width,
    runs_for_relative_error,
)


def test_bootstrap_of_a_mean_against_a_worked_number() -> None:
    low, high, error = mean_interval(np.arange(1.0, 21.0))
    assert (low, high) == pytest.approx((7.95, 12.95), abs=1e-9)
    assert error == pytest.approx(1.27741, abs=5e-6)


def test_interval_of_a_standard_deviation_against_a_worked_number() -> None:
    assert deviation_interval(1.0, 1000) == pytest.approx((0.958012, 1.045865), abs=5e-7)


@pytest.mark.parametrize(
    ("quantile", "confidence", "runs", "factor"), [(0.90, 0.95, 10, 2.35464), (0.9973, 0.90, 100, 3.09819)]
)
def test_tolerance_factor_of_a_normal_against_tables(
    quantile: float, confidence: float, runs: int, factor: float
) -> None:
    assert normal_tolerance_factor(quantile, confidence, runs) == pytest.approx(factor, abs=5e-6)


def test_a_rate_of_one_in_a_hundred_is_known_to_a_tenth_after_9900_runs() -> None:
    assert runs_for_relative_error(0.01, 0.1) == 9900
    assert relative_error_of_rate(0.01, 9900) == pytest.approx(0.1, rel=1e-12)


@pytest.mark.parametrize(("rate", "runs"), [(0.01, 1522), (0.5, 38416)])
def test_runs_for_half_a_percent_either_way(rate: float, runs: int) -> None:
    assert runs_for_half_width(rate, 0.005) == runs


def test_effective_sample_size_against_a_worked_number() -> None:
    assert effective_sample_size(np.array([1.0, 2.0, 3.0, 4.0])) == pytest.approx(10.0 / 3.0, rel=1e-15)
    assert effective_sample_size(np.full(7, 0.3)) == pytest.approx(7.0, rel=1e-12)


# Sum of five squares: var(u^2) is 4/45. In a Latin hypercube each coordinate has one point in each n-th of its range,
# which leaves var = 5 / (9 n^3). 200 repeats give a standard deviation to 5 per cent, 1 sigma.
PLANS: list[tuple[Plan, float, float]] = [
    ("random", math.sqrt(5.0 * 4.0 / 45.0 / 256.0), 0.2),
    ("latin_hypercube", math.sqrt(5.0 / (9.0 * 256.0**3)), 0.2),
    ("sobol", 0.00017, 0.4),
]


@pytest.mark.parametrize(("plan", "expected", "tolerance"), PLANS)
def test_spread_of_a_mean_under_sampling_plans(plan: Plan, expected: float, tolerance: float) -> None:
    found = deviation_of_mean(plan, lambda points: np.sum(points**2, axis=1), 5, 256, 200)
    assert found == pytest.approx(expected, rel=tolerance)


def test_holms_correction_against_a_worked_example() -> None:
    # Sorted .005, .01, .03, .04 times 4, 3, 2, 1, never falling: .02, .03, .06, .06.
    assert holm_correction(np.array([0.01, 0.04, 0.03, 0.005])).tolist() == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm_correction(np.array([0.9, 0.8])).tolist() == [1.0, 1.0]
