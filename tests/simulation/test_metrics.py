"""Metrics of records that were made by hand, so that each number can be worked out on paper."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.scenario import metric_catalogue
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics import recorded_metrics, trace_channels

TICKS = 90
SINGLE = 1e-6
"""Records are kept in single precision."""

Records = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def hour() -> ScenarioFile:
    """The nominal mission; only its rates, desired position and settling time count here."""
    return scenario_loader.load("inspection")


def still(ticks: int = TICKS, runs: int = 1) -> Records:
    """A perfect run: on its place, known exactly, always seen."""
    vector = np.zeros((runs, ticks, 3), np.float32)
    scalar = np.zeros((runs, ticks), np.float32)
    flag = np.ones((runs, ticks), bool)
    return {
        "rho_H": vector + np.array([0.0, -30.0, 0.0], np.float32),
        "relative_error_H": vector.copy(),
        "relative_sigma_H": vector + np.float32(1.0),
        "servicer_error_H": vector.copy(),
        "target_error_H": vector.copy(),
        "nees": scalar + np.float32(12.0),
        "nees_relative": scalar + np.float32(6.0),
        "gps_innovation_sigmas": vector + np.float32(1.0),
        "box_innovation_sigmas": vector + np.float32(1.0),
        "range_m": scalar + np.float32(30.0),
        "passive_range_m": scalar + np.float32(25.0),
        "box_present": flag.copy(),
        "box_accepted": flag.copy(),
        "box_outlier": ~flag,
        "observable": flag.copy(),
        "mode": np.full((runs, ticks), Mode.LOOK, np.int8),
        "pointing_error_deg": scalar + np.float32(0.5),
        "wheel_speed_fraction": vector.copy(),
        "delta_v_m_s": scalar.copy(),
    }


@pytest.fixture
def figures(hour: ScenarioFile) -> Callable[[Records], dict[str, float]]:
    """Metrics of one run."""

    def work_out(records: Records) -> dict[str, float]:
        return {name: float(values[0]) for name, values in recorded_metrics.evaluate(hour, records).items()}

    return work_out


def test_every_metric_has_a_unit_and_every_needed_channel_is_named(hour: ScenarioFile) -> None:
    assert set(recorded_metrics.evaluate(hour, still())) == set(metric_catalogue.UNITS)
    assert set(still()) == set(recorded_metrics.REQUIRED_CHANNELS)


def test_a_perfect_run_has_perfect_figures(figures: Callable[[Records], dict[str, float]]) -> None:
    found = figures(still())
    zeros = ("formation_error_rms_m", "nav_relative_position_error_rms_m", "boxes_rejected", "time_to_acquire_s")
    assert [found[name] for name in zeros] == [0.0] * 4
    assert (found["nees_mean"], found["nees_relative_mean"], found["sigma3_coverage"]) == (12.0, 6.0, 1.0)
    assert (found["detection_rate"], found["visible_fraction"], found["longest_unseen_s"]) == (1.0, 1.0, 0.0)


def test_formation_error_counts_the_last_third_and_navigation_errors_all_but_the_first(
    figures: Callable[[Records], dict[str, float]],
) -> None:
    records = still()
    records["rho_H"][:, :60] += 100.0
    records["rho_H"][:, 60:] += np.array([3.0, 0.0, -4.0])
    for place, name in enumerate(("relative_error_H", "servicer_error_H", "target_error_H"), 1):
        records[name][:, :30] = 100.0
        records[name][:, 30:60, 1] = place
    found = figures(records)
    np.testing.assert_allclose(found["formation_error_rms_m"], 5.0, rtol=SINGLE)
    shares = [found[f"nav_{who}_position_error_rms_m"] for who in ("relative", "servicer", "target")]
    np.testing.assert_allclose(shares, np.array([1.0, 2.0, 3.0]) * np.sqrt(0.5), rtol=SINGLE)


def test_windows_of_a_long_run_are_a_thousand_seconds(figures: Callable[[Records], dict[str, float]]) -> None:
    records = still(4000)
    records["rho_H"][:, 2999] += 1e3
    records["relative_error_H"][:, 999] = 1e3
    found = figures(records)
    assert found["formation_error_rms_m"] == 0.0
    assert found["nav_relative_position_error_rms_m"] == 0.0
    records["rho_H"][:, 3000, 0] += 1e3
    records["relative_error_H"][:, 1000, 0] = 1e3
    found = figures(records)
    np.testing.assert_allclose(found["formation_error_rms_m"], 1e3 / np.sqrt(1000.0), rtol=SINGLE)
    np.testing.assert_allclose(found["nav_relative_position_error_rms_m"], 1e3 / np.sqrt(3000.0), rtol=SINGLE)


def test_coverage_counts_each_second_and_axis(figures: Callable[[Records], dict[str, float]]) -> None:
    records = still()
    records["relative_error_H"][0, :9, 2] = -3.5
    records["relative_error_H"][0, 9:18, 2] = 2.5
    np.testing.assert_allclose(figures(records)["sigma3_coverage"], 1.0 - 9.0 / 270.0)


def test_boxes_are_counted_by_what_they_are_and_by_what_the_gate_did(
    figures: Callable[[Records], dict[str, float]],
) -> None:
    records = still()
    present, accepted, outlier = (records[name][0] for name in ("box_present", "box_accepted", "box_outlier"))
    present[:10], accepted[:10] = False, False  # not seen for ten seconds
    accepted[10:13] = False  # three good boxes refused
    outlier[20:24] = True  # four outliers, of which one is taken
    accepted[20:23] = False
    records["observable"][0, :4] = False
    found = figures(records)
    np.testing.assert_allclose(found["detection_rate"], 80.0 / 86.0)
    np.testing.assert_allclose(found["visible_fraction"], 74.0 / 90.0)
    np.testing.assert_allclose(found["good_boxes_rejected_fraction"], 3.0 / 76.0)
    assert (found["boxes_rejected"], found["outliers_accepted"]) == (6.0, 1.0)
    assert (found["time_to_acquire_s"], found["longest_unseen_s"]) == (13.0, 13.0)


def test_what_never_happens_is_undefined_and_not_zero(figures: Callable[[Records], dict[str, float]]) -> None:
    records = still()
    for name in ("box_present", "box_accepted", "observable"):
        records[name][:] = False
    records["mode"][:] = Mode.SEARCH
    found = figures(records)
    undefined = {name for name, value in found.items() if np.isnan(value)}
    expected = {
        "detection_rate",
        "good_boxes_rejected_fraction",
        "time_to_acquire_s",
        "pointing_error_p95_deg",
        "reacquisition_peak_s",
    }
    assert undefined == expected
    assert np.isnan(figures(still())["reacquisition_peak_s"])  # a target that was never hidden is not found again
    assert found["longest_unseen_s"] == TICKS


def test_reacquisition_is_the_longest_wait_from_first_light_to_an_accepted_box(
    figures: Callable[[Records], dict[str, float]],
) -> None:
    records = still()
    observable, accepted = records["observable"][0], records["box_accepted"][0]
    observable[10:30], accepted[10:34] = False, False  # found four seconds after sunrise
    observable[50:60], accepted[50:62] = False, False
    assert figures(records)["reacquisition_peak_s"] == 4.0
    accepted[60:] = False  # never found again: the wait lasts to the end
    assert figures(records)["reacquisition_peak_s"] == 29.0
    observable[65:] = False  # but not beyond the next sunset
    assert figures(records)["reacquisition_peak_s"] == 4.0


def test_the_largest_error_over_its_bound_is_that_of_the_worst_axis_at_the_worst_time(
    figures: Callable[[Records], dict[str, float]],
) -> None:
    records = still()
    records["relative_error_H"][0, 7] = [0.3, -2.4, 0.6]
    records["relative_sigma_H"][0, 7] = [0.5, 0.4, 0.1]  # 0.2, 2 and 2 of three sigma
    records["relative_error_H"][0, 8, 0] = 3.0
    np.testing.assert_allclose(figures(records)["error_over_sigma3_peak"], 2.0, rtol=SINGLE)


def test_pointing_counts_only_while_looking_and_settled(
    figures: Callable[[Records], dict[str, float]], hour: ScenarioFile
) -> None:
    settle = round(hour.pointing.settle_time_s)
    records = still()
    records["mode"][0, 40:50] = Mode.BURN
    records["pointing_error_deg"][0, 40 : 50 + settle] = 170.0
    np.testing.assert_allclose(figures(records)["pointing_error_p95_deg"], 0.5, rtol=SINGLE)
    records["pointing_error_deg"][0, 50 + settle :] = 2.0
    np.testing.assert_allclose(figures(records)["pointing_error_p95_deg"], 2.0, rtol=SINGLE)


def test_extremes_and_totals_are_over_the_whole_run(figures: Callable[[Records], dict[str, float]]) -> None:
    records = still()
    records["range_m"][0, 3] = 12.5
    records["passive_range_m"][0] = np.where(np.arange(TICKS) % 10, np.inf, 20.0)  # looked at once in ten ticks
    records["passive_range_m"][0, 40] = 7.5
    records["wheel_speed_fraction"][0, 5] = [0.1, -0.75, 0.2]
    records["delta_v_m_s"][0] = np.linspace(0.0, 0.25, TICKS)
    found = figures(records)
    assert (found["min_range_m"], found["wheel_speed_peak_fraction"], found["delta_v_m_s"]) == (12.5, 0.75, 0.25)
    assert found["passive_range_m"] == 7.5


def test_look_away_time_is_that_of_the_longest_decision_period(
    figures: Callable[[Records], dict[str, float]],
) -> None:
    records = still(600)
    mode = records["mode"][0]
    mode[100:110], mode[110:115], mode[115:130] = Mode.TURN, Mode.BURN, Mode.TURN_BACK
    mode[300:320], mode[390:399] = Mode.TURN, Mode.TURN_BACK
    mode[500:560] = Mode.SEARCH  # a search is not a look away
    assert figures(records)["look_away_peak_s"] == 30.0


def test_runs_do_not_mix(hour: ScenarioFile) -> None:
    records = still(runs=3)
    for values in records.values():
        values[1] = np.zeros_like(values[1])
    records["relative_sigma_H"][1] = 2.0
    alone = recorded_metrics.evaluate(hour, still())
    for name, values in recorded_metrics.evaluate(hour, records).items():
        np.testing.assert_array_equal(values[[0, 2]], np.repeat(alone[name], 2), err_msg=name)


def test_traces_are_every_nth_tick_as_norms(hour: ScenarioFile) -> None:
    records: dict[str, Any] = still(runs=2)
    records["relative_error_H"][1, 20] = [2.0, 3.0, 6.0]
    records["wheel_speed_fraction"][1, 20] = [0.1, -0.5, 0.2]
    found = trace_channels.decimated_traces(hour, records, 10)
    assert set(found) == set(trace_channels.TRACE_UNITS)
    assert all(values.shape == (2, 9) and values.dtype == np.float32 for values in found.values())
    assert found["nav_relative_error_m"][1, 2] == 7.0
    assert found["wheel_speed_fraction"][1, 2] == 0.5
    np.testing.assert_allclose(found["nav_relative_sigma3_m"], 3.0 * np.sqrt(3.0), rtol=SINGLE)


def test_innovations_that_follow_each_other_are_told_from_white_ones(
    figures: Callable[[Records], dict[str, float]],
) -> None:
    same = figures(still())
    assert (same["nis_gps_mean"], same["gps_innovation_lag1"]) == (3.0, 1.0)
    turning = still()
    turning["box_innovation_sigmas"][:, ::2] = -2.0
    found = figures(turning)
    assert found["nis_box_mean"] == pytest.approx(3 * (4 + 1) / 2)
    assert found["box_innovation_lag1"] == pytest.approx(-2.0 / 2.5)
    white = still()
    white["gps_innovation_sigmas"][:] = np.random.default_rng(0).normal(size=(1, TICKS, 3))
    assert abs(figures(white)["gps_innovation_lag1"]) < 3.0 / np.sqrt(3 * (TICKS - 1))


def test_ticks_without_a_whole_innovation_count_neither_for_nis_nor_for_whiteness(
    figures: Callable[[Records], dict[str, float]],
) -> None:
    records = still()
    records["box_innovation_sigmas"][:, 1::2, 2] = np.nan
    assert figures(records)["nis_box_mean"] == 3.0
    assert np.isnan(figures(records)["box_innovation_lag1"])
    records["box_innovation_sigmas"][:] = np.nan
    assert np.isnan(figures(records)["nis_box_mean"])
