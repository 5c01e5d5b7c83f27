"""Tests of phases in the frame of a target that turns: what they need, and what they are warned of."""

from pathlib import Path

import pytest

import rpojax
from rpojax.core.pytree import replace
from rpojax.errors import ScenarioError
from rpojax.scenario.warnings.mission_warnings import mission_warnings
from rpojax.vision.surface.landmark_file import load_landmarks, save_landmarks
from tests.scenario_error_assertions import assert_one_line


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        (["camera.landmarks=none"], "phases.synchronise.frame", "camera.landmarks, which show how the target turns"),
        (["phases.synchronise.control=burns"], "phases.synchronise.control", "'continuous'"),
        (
            ["phases.synchronise.reference={kind='transfer', position_m=[0.0, 0.0, 8.0], duration_s=600.0}"],
            "phases.synchronise.reference.kind",
            "one of hold, arc, approach, retreat, fly_around",
        ),
        (["phases.hold_20.frame=target"], "phases.hold_20.frame", "'hill' in the first phase"),
        (
            ["phases.approach.until={arrival_box_m=[0.3, 0.3, 0.3]}"],
            "phases.approach.until",
            "attitude_sigma_deg, as synchronise follows",
        ),
        (["phases.approach.until.attitude_sigma_deg=12"], "phases.approach.until.attitude_sigma_deg", "less than 11.5"),
        (["phases.approach.on_timeout=next"], "phases.approach.on_timeout", "'hold' or 'abort'"),
        (["phases.synchronise.on_timeout=hold"], "phases.synchronise.on_timeout", "'next' or 'abort'"),
        (["mission.hold_at_s=900"], "mission.hold_at_s", "none within the run"),
        (
            ["phases.synchronise.reference={kind='hold', position_m=[0.0, 0.0, 8.0]}"],
            "phases.synchronise.reference.kind",
            "'arc' first",
        ),
        (
            ["phases.capture.reference.position_m=[0.0, 0.0, 1.2]"],
            "phases.capture.reference",
            "outside of the keep-out zone of 1.3 m",
        ),
        (
            ["wide_lens.field_of_view_deg=20"],
            "phases.port_approach.reference.end_position_m",
            "a place that sees at least 6",
        ),
        (
            ["phases.port_approach.corridor.axis=[1.0, 0.0, 0.0]"],
            "phases.port_approach.reference",
            "a way inside of phases.port_approach.corridor",
        ),
        (
            ["phases.approach.until.attitude_sigma_for_s=2000"],
            "phases.approach.timeout_s",
            "attitude_sigma_for_s = 2000",
        ),
    ],
)
def test_a_phase_that_cannot_follow_the_target_is_refused(changes: list[str], key: str, words: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        rpojax.load("capture", changes)
    assert_one_line(caught.value, key)
    assert words in str(caught.value)


def test_landmarks_without_a_port_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "own.landmarks.safetensors"
    save_landmarks(replace(load_landmarks()[0], port_position=None, port_axis=None), path, {})
    with pytest.raises(ScenarioError, match="landmarks with a port") as caught:
        rpojax.load("capture", [f"camera.landmarks={path}"])
    assert_one_line(caught.value, "camera.landmarks")


def test_a_tumble_that_thrusters_hardly_follow_is_warned_of() -> None:
    assert not [each for each in mission_warnings(rpojax.load("capture")) if ".frame" in each]
    fast = rpojax.load("capture", ["dispersions.target.tumble_rate_deg_s=none", "target.tumble_rate_deg_s=2.5"])
    found = [each for each in mission_warnings(fast) if ".frame" in each]
    assert [each.partition(":")[0] for each in found] == ["phases.synchronise.frame", "phases.port_approach.frame"]
    assert "15.2 mm/s^2" in found[0]


def test_an_arc_that_is_too_short_for_the_thrusters_is_warned_of() -> None:
    (found,) = mission_warnings(rpojax.load("capture", ["phases.synchronise.reference.duration_s=100"]))
    assert found.startswith("phases.synchronise.reference.duration_s: in 100 s an arc over half a turn takes up to ")
