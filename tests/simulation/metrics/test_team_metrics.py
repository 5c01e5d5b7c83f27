"""Metrics of a team from those of its servicers, and from their channels."""

import numpy as np

from rpojax.metrics import metric_catalogue
from rpojax.metrics.metric_definition import Reduction
from rpojax.scenario.plugins.custom_metrics import make_metric, metric
from rpojax.scenario.schema import RequirementSection
from rpojax.simulation.metrics import team_metrics
from rpojax.simulation.outcomes.requirement_violations import required_values, violates

EACH = np.array([[1.0, 3.0], [5.0, 5.0], [np.nan, 5.0], [np.nan, np.nan]])


def test_errors_are_means_and_ranges_least_and_peaks_greatest() -> None:
    def joined(name: str) -> list[float]:
        return team_metrics.joined(metric_catalogue.find(name), EACH).tolist()

    assert joined("formation_error_rms_m")[:2] == [2.0, 5.0]
    assert joined("min_range_m")[:2] == [1.0, 5.0]
    assert joined("passive_range_24_h_m")[:2] == [1.0, 5.0]
    assert joined("passive_unsafe_fraction")[:2] == [3.0, 5.0]
    for longest in ("look_away_peak_s", "reacquisition_peak_s", "longest_unseen_s"):
        assert joined(longest)[:2] == [3.0, 5.0]
    assert joined("pointing_error_p95_deg")[:2] == [2.0, 5.0]
    # What is of one instant is the worst one: the nearest in the end, the last one to see the target.
    assert joined("final_range_m")[:2] == [1.0, 5.0]
    assert joined("final_range_m@hold_20")[:2] == [1.0, 5.0]
    assert joined("time_to_acquire_s")[:2] == [3.0, 5.0]
    assert joined("outliers_accepted")[:2] == joined("boxes_rejected")[:2] == [2.0, 5.0]

    # A servicer that never saw the target must not pass for the others' time.
    for name in ("formation_error_rms_m", "min_range_m", "look_away_peak_s", "time_to_acquire_s"):
        assert np.isnan(joined(name)[2:]).all()
    # A servicer without a burn has no drift after one.
    assert joined("stuck_on_range_24_h_m")[2] == 5.0
    # Nor has one that no eclipse took the target from a wait after it.
    assert joined("reacquisition_peak_s")[2] == joined("health_missed_fraction")[2] == 5.0
    assert np.isnan(joined("stuck_on_range_24_h_m")[3])


def test_of_a_users_function_of_whole_runs_a_team_has_the_worst_value() -> None:
    def joined(reduction: Reduction | None, low_is_bad: bool) -> list[float]:
        marked = metric(reduction, low_is_bad=low_is_bad)(lambda rho_H: rho_H)
        return team_metrics.joined(make_metric("angle_deg", marked, "deg"), EACH).tolist()

    assert joined(None, False)[:2] == [3.0, 5.0]
    assert joined(None, True)[:2] == [1.0, 5.0]
    assert np.isnan(joined(None, False)[2:]).all()
    assert joined("mean", False)[:2] == [2.0, 5.0]
    assert joined("max", True)[:2] == [3.0, 5.0]
    assert joined("end", True)[:2] == [1.0, 5.0]
    assert joined("end", False)[:2] == [3.0, 5.0]


def test_a_team_was_in_a_phase_if_all_its_servicers_were() -> None:
    def joined(name: str, each: list[list[float]]) -> np.ndarray:
        return team_metrics.joined(metric_catalogue.find(name), np.array(each))

    error = joined("formation_error_rms_m@hold_20", [[0.1, np.nan], [0.1, 0.3]])
    duration = joined("duration_s@hold_20", [[300.0, 0.0], [300.0, 200.0]])
    np.testing.assert_array_equal(duration, [0.0, 200.0])
    time = joined("event_time_s@hold_20.begin", [[300.0, np.nan], [300.0, 500.0]])
    np.testing.assert_array_equal(time, [np.nan, 500.0])
    requirement = RequirementSection(
        metric="formation_error_rms_m", bound="at most", limit=1.0, probability=0.9, consumer_risk=0.1, phase="hold_20"
    )
    metrics = {requirement.metric_name: error, requirement.window.presence_name: duration}
    assert violates(requirement, required_values(requirement, metrics)).tolist() == [True, False]


def test_separation_and_the_time_without_any_box() -> None:
    rho = np.zeros((1, 4, 3, 2))
    rho[0, :, 0, 1] = [5.0, 4.0, 3.0, 6.0]
    accepted = np.array([[[False, False], [True, False], [False, False], [False, True]]])
    records = {"rho_H": rho, "box_accepted": accepted, "box_outlier": np.zeros_like(accepted)}
    found = team_metrics.evaluate(2.0, records)
    assert found["min_separation_m"].tolist() == [3.0]
    assert found["team_unseen_peak_s"].tolist() == [2.0]


def test_metric_of_one_servicer_has_the_unit_of_the_metric() -> None:
    metric = metric_catalogue.find("min_range_m/beta")
    assert metric is not None
    assert (metric.unit, metric.name, metric.low_is_bad) == ("m", "min_range_m/beta", True)
    assert not metric_catalogue.is_of_campaigns("min_range_m/beta")
