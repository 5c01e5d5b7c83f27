"""Bounds and intervals against worked numbers and scipy."""

import numpy as np
import pytest
from scipy import stats

from rpojax.analysis.statistics import (
    mean_nees_interval,
    percentiles_over_runs,
    proportion_interval,
    quantile_upper_bound,
    rank_correlation,
    upper_bound_rank,
)


@pytest.mark.parametrize(
    ("quantile", "confidence", "runs"),
    [(0.95, 0.95, 59), (0.99, 0.95, 299), (0.99, 0.90, 230), (0.9973, 0.90, 852), (0.9973, 0.95, 1109)],
)
def test_the_largest_of_wilks_number_of_runs_is_the_bound_and_of_one_less_is_not(quantile, confidence, runs):
    assert upper_bound_rank(runs, quantile, confidence) == runs
    assert upper_bound_rank(runs - 1, quantile, confidence) is None


@pytest.mark.parametrize(("runs", "rank"), [(92, 92), (93, 92), (123, 122), (124, 122)])
def test_second_and_third_largest_take_over_at_wilks_numbers(runs, rank):
    assert upper_bound_rank(runs, 0.95, 0.95) == rank


def test_upper_rank_of_the_two_sided_interval_of_a_99th_percentile():
    assert upper_bound_rank(1000, 0.99, 0.975) == 997


def test_rank_is_the_smallest_that_reaches_the_confidence():
    rank = upper_bound_rank(1000, 0.99, 0.95)
    assert rank is not None
    assert stats.binom.cdf(rank - 1, 1000, 0.99) >= 0.95 > stats.binom.cdf(rank - 2, 1000, 0.99)


def test_bound_is_an_order_statistic_and_none_with_too_few_runs():
    values = np.random.default_rng(0).permutation(np.arange(1.0, 300.0))
    assert quantile_upper_bound(values) == 299.0
    assert quantile_upper_bound(values[:298]) is None
    assert quantile_upper_bound(np.array([])) is None


def test_bound_covers_the_true_quantile_as_often_as_it_says():
    samples = np.random.default_rng(1).exponential(size=(2000, 473))
    bounds = np.array([quantile_upper_bound(row) for row in samples])
    rank = upper_bound_rank(473, 0.99, 0.95)
    assert rank is not None
    expected = stats.binom.cdf(rank - 1, 473, 0.99)
    assert np.mean(bounds >= -np.log(0.01)) == pytest.approx(expected, abs=0.015)


def test_clopper_pearson_against_worked_numbers():
    assert proportion_interval(7, 1000) == pytest.approx((0.0028189, 0.0143692), abs=1e-7)
    assert proportion_interval(0, 1000) == pytest.approx((0.0, 0.0036821), abs=1e-7)
    assert proportion_interval(5, 5)[1] == 1.0


@pytest.mark.parametrize(
    ("runs", "components", "interval"), [(50, 6, (5.07825, 6.99749)), (100, 12, (11.05890, 12.97898))]
)
def test_interval_of_the_mean_nees_against_worked_numbers(runs, components, interval):
    assert mean_nees_interval(components, runs) == pytest.approx(interval, abs=1e-5)


def test_rank_correlation_against_a_worked_number_and_scipy_with_ties():
    assert rank_correlation(np.arange(8), np.array([2, 1, 4, 3, 6, 5, 8, 7])) == pytest.approx(0.9047619)
    rng = np.random.default_rng(2)
    x, y = rng.integers(0, 5, 200), rng.normal(size=200)
    assert rank_correlation(x, y) == pytest.approx(stats.spearmanr(x, y)[0])
    assert rank_correlation(np.ones(9), y[:9]) is None


def test_percentiles_agree_with_numpy_column_by_column_and_leave_out_nan():
    values = np.random.default_rng(3).normal(size=(31, 4))
    values[:7, 1] = np.nan
    values[:, 2] = np.nan
    values[1:, 3] = np.nan
    found = percentiles_over_runs(values, (0.0, 5.0, 50.0, 99.0, 100.0))
    for column in (0, 1, 3):
        finite = values[np.isfinite(values[:, column]), column]
        np.testing.assert_allclose(found[:, column], np.percentile(finite, [0, 5, 50, 99, 100]))
    assert np.isnan(found[:, 2]).all()
