"""Percentile bands and the worst run of envelope charts."""

import numpy as np
import pytest

from rpojax.report.labels import CHANNEL_LABELS
from rpojax.report.sections.envelope_section import envelope_chart, worst_run


def test_envelope_bands_contain_the_stated_percentage():
    values = np.random.default_rng(5).uniform(1.0, 2.0, (2000, 50))
    chart = envelope_chart(CHANNEL_LABELS[0], np.arange(50.0), values, np.ones(2000, bool))
    assert chart is not None
    low, high = (np.array(trace["y"]) for trace in chart["data"][2:4])
    share = np.mean((values >= low) & (values <= high))
    assert share == pytest.approx(0.90, abs=0.005)


@pytest.mark.parametrize(
    ("runs", "names"), [(1, set()), (19, {"smallest to largest"}), (99, {"smallest to largest", "5\N{EN DASH}95 %"})]
)
def test_bands_need_enough_runs(runs, names):
    values = np.random.default_rng(6).uniform(1.0, 2.0, (runs, 50))
    chart = envelope_chart(CHANNEL_LABELS[0], np.arange(50.0), values, np.ones(runs, bool))
    assert chart is not None
    assert {trace["legendgroup"] for trace in chart["data"] if "legendgroup" in trace} == names


def test_worst_run_is_completed_and_has_the_smallest_range():
    error, distance = CHANNEL_LABELS[0], CHANNEL_LABELS[2]
    values = np.array([[9.0, 1.0, 1.0], [0.0, 3.0, 3.0], [5.0, 8.0, np.nan]])
    completed = np.array([True, True, False])
    assert worst_run(error, values, completed) == 1
    assert worst_run(distance, values, completed) == 1
    assert worst_run(error, values, ~completed & False) is None
