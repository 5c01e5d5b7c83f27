"""Metrics of recorded quantities of six ticks, against values by hand.

The late window begins at the third tick, the last window at the fifth.
"""

import numpy as np
import pytest

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.metrics import attitude, camera_boxes, filter_consistency, position_errors, target_attitude, trajectory
from rpojax.metrics.metric_definition import Metric, RunTiming
from rpojax.metrics.recorded_reduction import reduce_records

TIMING = RunTiming(tick_s=1.0, decision_ticks=3)
MODULES = (attitude, camera_boxes, filter_consistency, position_errors, target_attitude, trajectory)
BY_NAME: dict[str, Metric] = {each.name: each for module in MODULES for each in module.METRICS}


def flags(row: str) -> np.ndarray:
    return np.array([each == "x" for each in row])


SIX = np.arange(6.0)
RHO = np.array([[0.0, -30.0, 0.0]] * 4 + [[0.0, 0.0, 40.0], [0.0, 0.0, 0.0]])
DESIRED = RHO + np.array([[9.0, 9.0, 9.0]] * 4 + [[1.0, 2.0, -2.0], [0.0, -4.0, 0.0]])
ERROR = np.array([[9.0, 9.0, 9.0]] * 2 + [[1.0, 2.0, -2.0]] * 3 + [[3.0, 0.0, 0.0]])
SIGMA = np.array([[3.0, 3.0, 3.0]] * 2 + [[1.0, 0.5, 1.0]] * 4)
INNOVATION = np.array([[1.0, 2.0, -2.0], [np.nan, 1.0, 1.0], [3.0, 0.0, 0.0], [1.0, 1.0, 0.0], *2 * [3 * [np.nan]]])
RECORDS = {
    "box_accepted": flags(".x..xx"),
    "box_present": flags(".xx.xx"),
    "box_outlier": flags("..x..x"),
    "observable": flags(".xxxx."),
    "pointing_error_deg": np.array([5.0, 1.0, 2.0, 3.0, 100.0, 4.0]),
    "is_settled": flags(".xxx.x"),
    "wheel_speed_fraction": np.array([[0.1, -0.7, 0.3]] * 6),
    "mode": np.array([Mode.TURN, Mode.BURN, Mode.LOOK, Mode.TURN_BACK, Mode.SEARCH, Mode.BURN]),
    "delta_v_m_s": 0.1 * SIX,
    "range_m": np.array([30.0, 20.0, 25.0, 28.0, 40.0, 35.0]),
    "rho_H": RHO,
    "desired_position_H": DESIRED,
    "relative_error_H": ERROR,
    "relative_sigma_H": SIGMA,
    "servicer_error_H": 2.0 * ERROR,
    "target_error_H": 3.0 * ERROR,
    "nees": SIX,
    "nees_relative": 2.0 * SIX,
    "gps_innovation_sigmas": INNOVATION,
    "box_innovation_sigmas": 2.0 * INNOVATION,
    "target_attitude_error_T_deg": ERROR,
    "target_rate_error_T_deg_s": 0.1 * ERROR,
    "docking_axis_error_T_deg": 0.2 * ERROR,
    "target_attitude_known": flags("xx..xx"),
    "nees_pose": np.array([np.nan, 6.0, np.nan, np.nan, 5.0, 8.0]),
}
LATE_RMS = np.sqrt((3 * 9.0 + 9.0) / 4.0)
EXPECTED = {
    # Of 1, 2, 3 and 4 deg, 5 % of the way from the last one to the one before.
    "pointing_error_p95_deg": 4.0 - 0.15,
    "wheel_speed_peak_fraction": 0.7,
    "look_away_peak_s": 2.0,
    # Seen at once at the second tick; the box of the fifth is not after a shadow.
    "reacquisition_peak_s": 0.0,
    "longest_unseen_s": 2.0,
    "time_to_acquire_s": 1.0,
    "visible_fraction": 3.0 / 6.0,
    "detection_rate": 3.0 / 4.0,
    "boxes_rejected": 1.0,
    "good_boxes_rejected_fraction": 0.0,
    "outliers_accepted": 1.0,
    "nees_mean": 2.5,
    "nees_relative_mean": 5.0,
    "nis_gps_mean": (9.0 + 9.0 + 2.0) / 3.0,
    "nis_box_mean": 4.0 * (9.0 + 9.0 + 2.0) / 3.0,
    "gps_innovation_lag1": 3.0 / 5.5,
    "box_innovation_lag1": 3.0 / 5.5,
    # Two ticks at the bound of 9, which counts; of the others 2 m exceed 1.5 m at three ticks.
    "sigma3_coverage": 15.0 / 18.0,
    "error_over_sigma3_peak": 2.0 / 1.5,
    "formation_error_rms_m": np.sqrt((9.0 + 16.0) / 2.0),
    "nav_relative_position_error_rms_m": LATE_RMS,
    "nav_servicer_position_error_rms_m": 2.0 * LATE_RMS,
    "nav_target_position_error_rms_m": 3.0 * LATE_RMS,
    # 2 m along -y twice, -2 m along z, and no direction at the target itself.
    "nav_range_error_rms_m": np.sqrt(3.0 * 4.0 / 4.0),
    # Known at the last two ticks of the late window alone.
    "target_attitude_error_deg": 3.0,
    "target_rate_error_deg_s": 0.3,
    "docking_axis_error_deg": 0.6,
    "nees_pose_mean": 6.5,
    "target_attitude_known_fraction": 0.5,
    "delta_v_m_s": 0.5,
    "min_range_m": 20.0,
    "final_range_m": 35.0,
}


@pytest.mark.parametrize("name", EXPECTED)
def test_a_metric_has_its_value_by_hand(name: str) -> None:
    metric = BY_NAME[name]
    found = reduce_records(metric, {key: RECORDS[key][None] for key in metric.inputs}, TIMING)
    np.testing.assert_allclose(found, [EXPECTED[name]], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", [each.name for each in target_attitude.METRICS if each.source == "records"])
def test_the_errors_of_an_attitude_that_is_never_known_are_not_defined(name: str) -> None:
    records = {**RECORDS, "target_attitude_known": flags("xx...."), "nees_pose": np.full(6, np.nan)}
    metric = BY_NAME[name]
    (found,) = reduce_records(metric, {key: records[key][None] for key in metric.inputs}, TIMING)
    assert found == 0.0 if name == "target_attitude_known_fraction" else np.isnan(found)


def test_all_metrics_of_records_have_a_value_by_hand() -> None:
    assert set(EXPECTED) == {name for name, metric in BY_NAME.items() if metric.source == "records"}
