"""Paired comparison of the means of a tuned scenario with those of its start."""

import numpy as np
import pytest

from rpojax.analysis.gradients.tuning.tune import compare_means
from rpojax.analysis.statistics.paired_comparison import MIN_PAIRS, RunMetrics, compare_paired_runs

RUNS = 40


def test_ratios_are_of_runs_with_both_values_and_left_out_where_a_mean_may_have_either_sign() -> None:
    random = np.random.default_rng(3)
    error, around_zero = random.uniform(1.0, 2.0, RUNS), random.normal(0.0, 0.1, RUNS)
    some = np.where(np.arange(RUNS) < 3, np.nan, error)
    start = {"error_m": error, "some_m": some, "correlation": around_zero, "negative": -error, "zero": 0.0 * error}
    tuned = {name: 0.5 * values for name, values in start.items()} | {"some_m": 2.0 * error}
    completed = np.full(RUNS, "completed")
    found = compare_means(*(RunMetrics(np.arange(RUNS), completed, values) for values in (start, tuned)))
    assert set(found) == {"error_m", "some_m", "negative"}
    assert found["error_m"].ratio == pytest.approx(0.5)
    assert found["error_m"].ratio_95 == pytest.approx((0.5, 0.5))
    assert found["negative"].ratio == pytest.approx(0.5)
    assert found["some_m"].first == pytest.approx(error[3:].mean())
    assert found["some_m"].ratio == pytest.approx(2.0)


@pytest.mark.parametrize(("runs", "has_interval"), [(1, False), (MIN_PAIRS - 1, False), (MIN_PAIRS, True)])
def test_means_have_intervals_from_as_many_pairs_as_a_comparison(runs: int, has_interval: bool) -> None:
    error = np.random.default_rng(4).uniform(1.0, 2.0, RUNS)
    start = np.where(np.arange(RUNS) < runs, error, np.nan)
    one, other = (
        RunMetrics(np.arange(RUNS), np.full(RUNS, "completed"), {"error_m": values}) for values in (start, 2.0 * error)
    )
    change = compare_means(one, other)["error_m"]
    assert (change.pairs, change.ratio) == (runs, pytest.approx(2.0))
    median = compare_paired_runs(one, other, (), independent=True).metrics[0]
    assert median.pairs == runs
    assert {each is not None for each in (change.first_95, change.second_95, change.ratio_95)} == {has_interval}
    assert (median.difference.interval_95 is not None) == has_interval
