"""Confidence intervals of quantiles, mean and standard deviation."""

import numpy as np
import pytest

from rpojax.report.metric_statistics import mean_confidence_interval, summary_statistics


def test_quantile_intervals_are_order_statistics():
    values = np.arange(1.0, 1001.0)
    entry = summary_statistics("delta_v_m_s", values, True)
    # Row of a table: for q = 0.99 and 1000 runs the ranks are 983 and 997.
    assert entry["p99_interval_95"] == [983.0, 997.0]
    assert summary_statistics("delta_v_m_s", values[:100], True)["p99_interval_95"][1] is None
    # For 1000 runs the interval of the deviation is 0.958012 to 1.045865 of it.
    assert np.array(entry["std_interval_95"]) / entry["std"] == pytest.approx([0.958012, 1.045865], abs=1e-6)
    assert entry["mean_interval_method"] == "normal"


def test_mean_interval_is_bootstrapped_for_few_runs():
    made = mean_confidence_interval(np.arange(1.0, 21.0))
    assert made is not None
    # scipy's BCa with 9999 resamples gives 7.95 to 12.95.
    assert made[0] == pytest.approx([7.95, 12.95], abs=0.15)
    assert made[1] == "bootstrap (BCa)"
    assert mean_confidence_interval(np.arange(9.0)) is None
    assert mean_confidence_interval(np.full(20, 3.0)) == ([3.0, 3.0], "all runs agree")
    rng = np.random.default_rng(4)
    hits = sum(
        made[0][0] <= 1.0 <= made[0][1]
        for _ in range(100)
        if (made := mean_confidence_interval(rng.exponential(1.0, 600))) is not None
    )
    assert 88 <= hits <= 100
