"""Paired comparison of the means of a tuned scenario with those of its start."""

import numpy as np
import pytest

from rpojax.analysis.gradients.tuning.tune import compare_means
from rpojax.analysis.statistics.paired_comparison import RunMetrics

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
