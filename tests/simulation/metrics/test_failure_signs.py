"""Signs of failures of synthetic records with known values."""

import numpy as np
import pytest
from synthetic_channel_records import Records, perfect_run

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.flight.mission.mission_state import AbortReason
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics import failure_signs


@pytest.fixture(scope="module")
def file() -> ScenarioFile:
    """The nominal scenario; only its rates and its camera matter."""
    return scenario_loader.load("inspection")


def records(ticks: int = 90) -> Records:
    """Records of a perfect run, with the channels that only signs need."""
    found = perfect_run(ticks)
    none = np.zeros((1, ticks), bool)
    more = {"box_truncated": none, "running": ~none, "star_tracker_present": ~none}
    return {**found, **more, "failed_tests": np.zeros((1, ticks), np.int16)}


def test_a_perfect_run_has_frames_with_boxes_and_nothing_else(file: ScenarioFile) -> None:
    signs = failure_signs.evaluate(file, records(), {})
    full = {"ticks", "looking", "in_view", "good_boxes"}
    assert {name: values.tolist() for name, values in signs.items()} == {
        name: [[30, 30, 30]] if name in full else [[0, 0, 0]] for name in (*failure_signs.COUNTS, "failed_tests")
    }


def test_each_sign_is_counted_in_its_interval(file: ScenarioFile) -> None:
    run = records()
    run["box_truncated"][0, :5] = True
    run["box_outlier"][0, 30:37] = True
    run["box_accepted"][0, 60:64] = False
    run["observable"][0, 80:] = False
    run["nav_confident"][0, 31] = False
    run["star_tracker_present"][0, 2] = False
    run["relative_error_H"][0, 10, 1] = 4.0
    run["failed_tests"][0, 40], run["failed_tests"][0, 41] = 2, 16
    signs = {name: values[0].tolist() for name, values in failure_signs.evaluate(file, run, {}).items()}
    assert signs["cut"] == [5, 0, 0]
    assert signs["false_boxes"] == signs["false_accepted"] == [0, 7, 0]
    assert signs["good_boxes"] == [30, 23, 20]
    assert signs["good_rejected"] == [0, 0, 4]
    assert signs["dark"] == [0, 0, 10]
    assert signs["unconfident"] == [0, 1, 0]
    assert signs["no_star_tracker"] == signs["outside_3_sigma"] == [1, 0, 0]
    assert signs["failed_tests"] == [0, 18, 0]


def test_frames_of_turns_are_no_looks_and_a_target_beside_the_field_of_view_is_out_of_view(file: ScenarioFile) -> None:
    run = records()
    run["mode"][0, :10], run["mode"][0, 30:40] = Mode.TURN, Mode.SEARCH
    run["pointing_error_deg"][0, 5:40] = 6.0
    signs = {name: values[0].tolist() for name, values in failure_signs.evaluate(file, run, {}).items()}
    assert signs["looking"] == [20, 30, 30]
    assert signs["in_view"] == [5, 20, 30]
    assert signs["out_of_view"] == [20, 10, 0]


def test_nothing_is_counted_after_a_run_was_frozen(file: ScenarioFile) -> None:
    run = records()
    run["running"][0, 45:] = False
    run["failed_tests"][0, 50] = 2
    signs = failure_signs.evaluate(file, run, {})
    assert signs["ticks"].tolist() == [[30, 15, 0]]
    assert not signs["failed_tests"].any()


@pytest.mark.parametrize(("reason", "ticks"), [(AbortReason.CONFIDENCE_LOST, 46), (AbortReason.COMMAND, 90)])
def test_nothing_is_counted_after_the_tick_of_an_abort_that_was_not_commanded(
    file: ScenarioFile, reason: AbortReason, ticks: int
) -> None:
    run = records()
    run["abort_reason"] = np.where(np.arange(90) < 45, AbortReason.NONE, reason).astype(np.int8)[None]
    run["failed_tests"][0, 45], run["relative_error_H"][0, 46:, 1] = 16, 4.0
    signs = failure_signs.evaluate(file, run, {})
    assert (signs["ticks"].sum(), signs["outside_3_sigma"].sum()) == (ticks, ticks - 46)
    assert signs["failed_tests"].tolist() == [[0, 16, 0]]


def test_a_long_run_has_at_most_64_intervals_and_records_without_the_channels_have_no_signs(file: ScenarioFile) -> None:
    assert failure_signs.evaluate(file, records(6001), {})["ticks"].shape == (1, 64)
    assert failure_signs.evaluate(file, perfect_run(), {}) == {}


def test_the_lens_is_that_of_the_run(file: ScenarioFile) -> None:
    run = records()
    run["pointing_error_deg"] = np.full_like(run["pointing_error_deg"], 4.5)
    seen = {
        lens: failure_signs.evaluate(file, run, {"camera.field_of_view_deg": np.array([lens])}) for lens in (8.0, 10.0)
    }
    assert seen[8.0]["in_view"].sum() == 0
    assert seen[10.0]["in_view"].sum() == seen[10.0]["looking"].sum() > 0
