"""False alarms and missed detections, from hand-made records."""

from typing import Any

import numpy as np
import pytest

from rpojax.metrics.metric_catalogue import METRICS
from rpojax.metrics.metric_definition import RunTiming
from rpojax.metrics.recorded_reduction import reduce_records

RECORDS: dict[str, Any] = {
    "nav_confident": np.array([[True, False, True, False, True]]),
    "nees_relative": np.array([[6.0, 17.9, 18.1, 151.0, 151.0]]),
    "relative_error_H": np.zeros((1, 5, 3)),
    "range_m": np.full((1, 5), 30.0),
}


def fraction(name: str, **changes: Any) -> float:
    return float(reduce_records(METRICS[name], RECORDS | changes, RunTiming(1.0, 200))[0])


def test_shares_of_good_and_bad_times() -> None:
    assert fraction("confident_fraction") == pytest.approx(0.6)
    assert fraction("health_false_alarm_fraction") == 0.5
    assert fraction("health_missed_fraction") == 0.5


def test_an_error_of_more_than_half_the_range_should_be_detected() -> None:
    error = np.zeros((1, 5, 3))
    error[0, 0] = [0.0, 15.1, 0.0]
    error[0, 1] = [0.0, 14.9, 0.0]
    assert fraction("health_missed_fraction", relative_error_H=error) == pytest.approx(2.0 / 3.0)


def test_without_a_bad_time_nothing_can_be_missed() -> None:
    assert np.isnan(fraction("health_missed_fraction", nees_relative=np.full((1, 5), 6.0)))
