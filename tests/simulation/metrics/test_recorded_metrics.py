"""Metrics of synthetic records with known values."""

from collections.abc import Callable

import numpy as np
import pytest
from synthetic_channel_records import SINGLE, TICKS, Records, perfect_run

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.metrics import metric_catalogue
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics import recorded_metrics


@pytest.fixture(scope="module")
def hour() -> ScenarioFile:
    """The nominal scenario; only its rates, desired position and settling time matter."""
    return scenario_loader.load("inspection")


@pytest.fixture
def metrics(hour: ScenarioFile) -> Callable[[Records], dict[str, float]]:
    """Metrics of one run."""

    def evaluate(records: Records) -> dict[str, float]:
        return {name: float(values[0]) for name, values in recorded_metrics.evaluate(hour, records, {}).items()}

    return evaluate


def test_every_metric_has_a_unit_and_all_channels_are_listed(hour: ScenarioFile) -> None:
    metrics = metric_catalogue.METRICS.values()
    of_records = {metric.name for metric in metrics if metric.source == "records" and metric.needs is None}
    assert set(recorded_metrics.evaluate(hour, perfect_run(), {})) == of_records
    assert of_records < set(metric_catalogue.UNITS)
    assert set(perfect_run()) == set(recorded_metrics.REQUIRED_CHANNELS)


def test_metrics_of_a_perfect_run(metrics: Callable[[Records], dict[str, float]]) -> None:
    found = metrics(perfect_run())
    zeros = ("formation_error_rms_m", "nav_relative_position_error_rms_m", "boxes_rejected", "time_to_acquire_s")
    assert [found[name] for name in zeros] == [0.0] * 4
    assert (found["nees_mean"], found["nees_relative_mean"], found["sigma3_coverage"]) == (12.0, 6.0, 1.0)
    assert (found["detection_rate"], found["visible_fraction"], found["longest_unseen_s"]) == (1.0, 1.0, 0.0)


def test_windows_of_a_short_run_are_thirds(
    metrics: Callable[[Records], dict[str, float]],
) -> None:
    records = perfect_run()
    records["rho_H"][:, :60] += 100.0
    records["rho_H"][:, 60:] += np.array([3.0, 0.0, -4.0])
    for index, name in enumerate(("relative_error_H", "servicer_error_H", "target_error_H"), 1):
        records[name][:, :30] = 100.0
        records[name][:, 30:60, 1] = index
    found = metrics(records)
    np.testing.assert_allclose(found["formation_error_rms_m"], 5.0, rtol=SINGLE)
    errors = [found[f"nav_{who}_position_error_rms_m"] for who in ("relative", "servicer", "target")]
    np.testing.assert_allclose(errors, np.array([1.0, 2.0, 3.0]) * np.sqrt(0.5), rtol=SINGLE)


def test_windows_of_a_long_run_are_a_thousand_seconds(metrics: Callable[[Records], dict[str, float]]) -> None:
    records = perfect_run(4000)
    records["rho_H"][:, 2999] += 1e3
    records["relative_error_H"][:, 999] = 1e3
    found = metrics(records)
    assert found["formation_error_rms_m"] == 0.0
    assert found["nav_relative_position_error_rms_m"] == 0.0
    records["rho_H"][:, 3000, 0] += 1e3
    records["relative_error_H"][:, 1000, 0] = 1e3
    found = metrics(records)
    np.testing.assert_allclose(found["formation_error_rms_m"], 1e3 / np.sqrt(1000.0), rtol=SINGLE)
    np.testing.assert_allclose(found["nav_relative_position_error_rms_m"], 1e3 / np.sqrt(3000.0), rtol=SINGLE)


def test_coverage_is_the_fraction_of_seconds_and_axes(metrics: Callable[[Records], dict[str, float]]) -> None:
    records = perfect_run()
    records["relative_error_H"][0, :9, 2] = -3.5
    records["relative_error_H"][0, 9:18, 2] = 2.5
    np.testing.assert_allclose(metrics(records)["sigma3_coverage"], 1.0 - 9.0 / 270.0)


def test_boxes_are_counted_by_truth_and_gate(
    metrics: Callable[[Records], dict[str, float]],
) -> None:
    records = perfect_run()
    present, accepted, outlier = (records[name][0] for name in ("box_present", "box_accepted", "box_outlier"))
    present[:10], accepted[:10] = False, False  # no box for ten seconds
    accepted[10:13] = False  # three good boxes rejected
    outlier[20:24] = True  # four outliers, one of them accepted
    accepted[20:23] = False
    records["observable"][0, :4] = False
    found = metrics(records)
    np.testing.assert_allclose(found["detection_rate"], 80.0 / 86.0)
    np.testing.assert_allclose(found["visible_fraction"], 74.0 / 90.0)
    np.testing.assert_allclose(found["good_boxes_rejected_fraction"], 3.0 / 76.0)
    assert (found["boxes_rejected"], found["outliers_accepted"]) == (6.0, 1.0)
    assert (found["time_to_acquire_s"], found["longest_unseen_s"]) == (13.0, 13.0)


def test_metrics_without_events_are_undefined(metrics: Callable[[Records], dict[str, float]]) -> None:
    records = perfect_run()
    for name in ("box_present", "box_accepted", "observable"):
        records[name][:] = False
    records["mode"][:] = Mode.SEARCH
    found = metrics(records)
    undefined = {name for name, value in found.items() if np.isnan(value)}
    expected = {
        "confidence_withdrawn_s",
        "detection_rate",
        "good_boxes_rejected_fraction",
        "time_to_acquire_s",
        "health_missed_fraction",
        "pointing_error_p95_deg",
        "reacquisition_peak_s",
    }
    assert undefined == expected
    assert np.isnan(metrics(perfect_run())["reacquisition_peak_s"])  # without an interruption there is no reacquisition
    assert found["longest_unseen_s"] == TICKS


def test_reacquisition_is_the_longest_time_from_visibility_to_an_accepted_box(
    metrics: Callable[[Records], dict[str, float]],
) -> None:
    records = perfect_run()
    observable, accepted = records["observable"][0], records["box_accepted"][0]
    observable[10:30], accepted[10:34] = False, False  # accepted four seconds after sunrise
    observable[50:60], accepted[50:62] = False, False
    assert metrics(records)["reacquisition_peak_s"] == 4.0
    accepted[60:] = False  # never accepted again: to the end of the run
    assert metrics(records)["reacquisition_peak_s"] == 29.0
    observable[65:] = False  # at most to the next sunset
    assert metrics(records)["reacquisition_peak_s"] == 4.0


def test_the_peak_ratio_is_over_axes_and_time(
    metrics: Callable[[Records], dict[str, float]],
) -> None:
    records = perfect_run()
    records["relative_error_H"][0, 7] = [0.3, -2.4, 0.6]
    records["relative_sigma_H"][0, 7] = [0.5, 0.4, 0.1]  # 0.2, 2 and 2 of three sigma
    records["relative_error_H"][0, 8, 0] = 3.0
    np.testing.assert_allclose(metrics(records)["error_over_sigma3_peak"], 2.0, rtol=SINGLE)


def test_the_pointing_error_is_of_settled_pointing_only(
    metrics: Callable[[Records], dict[str, float]], hour: ScenarioFile
) -> None:
    settle = round(hour.pointing.settle_time_s)
    records = perfect_run()
    records["mode"][0, 40:50] = Mode.BURN
    records["pointing_error_deg"][0, 40 : 50 + settle] = 170.0
    np.testing.assert_allclose(metrics(records)["pointing_error_p95_deg"], 0.5, rtol=SINGLE)
    records["pointing_error_deg"][0, 50 + settle :] = 2.0
    np.testing.assert_allclose(metrics(records)["pointing_error_p95_deg"], 2.0, rtol=SINGLE)


def test_extremes_and_totals_are_over_the_whole_run(metrics: Callable[[Records], dict[str, float]]) -> None:
    records = perfect_run()
    records["range_m"][0, 3] = 12.5
    records["wheel_speed_fraction"][0, 5] = [0.1, -0.75, 0.2]
    records["delta_v_m_s"][0] = np.linspace(0.0, 0.25, TICKS)
    found = metrics(records)
    assert (found["min_range_m"], found["wheel_speed_peak_fraction"], found["delta_v_m_s"]) == (12.5, 0.75, 0.25)


def test_the_look_away_time_is_the_largest_of_a_decision_period(
    metrics: Callable[[Records], dict[str, float]],
) -> None:
    records = perfect_run(600)
    mode = records["mode"][0]
    mode[100:110], mode[110:115], mode[115:130] = Mode.TURN, Mode.BURN, Mode.TURN_BACK
    mode[300:320], mode[390:399] = Mode.TURN, Mode.TURN_BACK
    mode[500:560] = Mode.SEARCH  # a search is not a look away
    assert metrics(records)["look_away_peak_s"] == 30.0


def test_runs_do_not_affect_each_other(hour: ScenarioFile) -> None:
    records = perfect_run(runs=3)
    for values in records.values():
        values[1] = np.zeros_like(values[1])
    records["relative_sigma_H"][1] = 2.0
    alone = recorded_metrics.evaluate(hour, perfect_run(), {})
    for name, values in recorded_metrics.evaluate(hour, records, {}).items():
        np.testing.assert_array_equal(values[[0, 2]], np.repeat(alone[name], 2), err_msg=name)


def test_innovation_autocorrelation_distinguishes_white_innovations(
    metrics: Callable[[Records], dict[str, float]],
) -> None:
    constant = metrics(perfect_run())
    assert (constant["nis_gps_mean"], constant["gps_innovation_lag1"]) == (3.0, 1.0)
    alternating = perfect_run()
    alternating["box_innovation_sigmas"][:, ::2] = -2.0
    found = metrics(alternating)
    assert found["nis_box_mean"] == pytest.approx(3 * (4 + 1) / 2)
    assert found["box_innovation_lag1"] == pytest.approx(-2.0 / 2.5)
    white = perfect_run()
    white["gps_innovation_sigmas"][:] = np.random.default_rng(0).normal(size=(1, TICKS, 3))
    assert abs(metrics(white)["gps_innovation_lag1"]) < 3.0 / np.sqrt(3 * (TICKS - 1))


def test_ticks_with_incomplete_innovations_are_excluded(
    metrics: Callable[[Records], dict[str, float]],
) -> None:
    records = perfect_run()
    records["box_innovation_sigmas"][:, 1::2, 2] = np.nan
    assert metrics(records)["nis_box_mean"] == 3.0
    assert np.isnan(metrics(records)["box_innovation_lag1"])
    records["box_innovation_sigmas"][:] = np.nan
    assert np.isnan(metrics(records)["nis_box_mean"])
