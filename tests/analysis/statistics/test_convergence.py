"""Estimates over the first runs of a campaign against those of numpy and scipy on the same runs."""

import numpy as np
import pytest
from scipy.stats import binomtest

from rpojax.analysis.statistics.convergence import metric_convergence, rate_convergence, sample_sizes


@pytest.mark.parametrize(("runs", "first"), [(10000, 10), (11, 10), (10, 10), (3, 3)])
def test_counts_rise_evenly_to_all_runs(runs: int, first: int) -> None:
    found = sample_sizes(runs)
    assert (found[0], found[-1]) == (first, runs)
    assert (np.diff(found) > 0).all()
    assert len(found) <= 20
    if runs == 10000:
        assert len(found) == 20
        np.testing.assert_allclose(np.diff(np.log(found[8:])), np.log(1000.0) / 19.0, rtol=0.02)


def test_each_estimate_is_that_of_the_first_runs() -> None:
    values = np.random.default_rng(0).exponential(size=600)
    found = metric_convergence(values)
    for index, number in enumerate(found.runs):
        first = values[:number]
        assert found.median[index] == np.median(first)
        assert found.tail[index] == np.percentile(first, 99.0)
        assert found.median_low[index] < found.median[index] < found.median_high[index]
    # 299 runs are the fewest with a bound of the 99th percentile, their largest.
    assert (np.isfinite(found.tail_bound) == (found.runs >= 299)).all()
    bounded = int(np.argmax(found.runs >= 299))
    assert found.tail_bound[bounded] == values[: found.runs[bounded]].max()


def test_the_interval_of_a_median_is_the_exact_one_from_ranks() -> None:
    # Of 100 runs the 40th and the 61st smallest, as tables of the sign test have it.
    found = metric_convergence(np.random.default_rng(1).permutation(np.arange(1.0, 101.0)))
    assert (found.median_low[-1], found.median_high[-1]) == (40.0, 61.0)


def test_a_metric_whose_low_values_are_bad_is_the_mirror_image() -> None:
    values = np.random.default_rng(2).exponential(size=600)
    failed = np.arange(600) % 97 == 0
    values[failed] = np.nan
    high, low = metric_convergence(values), metric_convergence(-values, low_is_bad=True)
    np.testing.assert_array_equal(low.tail_bound, -high.tail_bound)
    np.testing.assert_array_equal(low.median_low, -high.median_high)
    np.testing.assert_array_equal(low.tail, -high.tail)


def test_runs_without_a_value_count_as_worse_than_all_others_in_the_bound_alone() -> None:
    values = np.arange(1.0, 401.0)
    values[399] = np.nan
    found = metric_convergence(values)
    assert found.median[-1] == np.median(values[:399])
    # From 299 to 472 runs the bound is the largest; it has none.
    assert np.isnan(found.tail_bound[-1])


def test_a_metric_that_no_run_has() -> None:
    assert np.isnan(metric_convergence(np.full(30, np.nan)).median).all()
    assert len(metric_convergence(np.zeros(0)).runs) == 0
    assert len(rate_convergence(np.zeros(0, bool)).runs) == 0


def test_the_rate_of_an_event_has_its_exact_interval() -> None:
    events = np.random.default_rng(3).random(400) < 0.1
    found = rate_convergence(events)
    for number, rate, low, high in zip(found.runs, found.rate, found.low, found.high, strict=True):
        count = int(events[:number].sum())
        exact = binomtest(count, int(number)).proportion_ci()
        assert rate == count / number
        assert (low, high) == pytest.approx((exact.low, exact.high), rel=1e-6)
