"""Tests of the checks of landmarks, and of what a scenario with them is."""

from pathlib import Path

import numpy as np
import pytest

import rpojax
from rpojax.core.pytree import replace
from rpojax.errors import RpojaxError, ScenarioError
from rpojax.scenario import params
from rpojax.scenario.loading import scenario_loader
from rpojax.sensors.additional.landmark_camera import MOST
from rpojax.vision.surface.landmark_file import load_landmarks, save_landmarks
from rpojax.vision.surface.landmarks import Landmarks
from tests.scenario_error_assertions import assert_one_line

ON = "camera.landmarks=packaged"


def file_of(tmp_path: Path, change: Landmarks) -> str:
    """Override with a file of these landmarks."""
    path = tmp_path / "own.landmarks.safetensors"
    save_landmarks(change, path, {})
    return f"camera.landmarks={path}"


def enlarged(factor: float) -> Landmarks:
    """Landmarks of the packaged target, `factor` times as far from the centre of mass."""
    packaged = load_landmarks()[0]
    return replace(packaged, positions=factor * packaged.positions)


@pytest.mark.parametrize(
    ("scenario", "changes", "key", "words"),
    [
        ("inspection", ["landmarks.noise_px=1.0"], "landmarks", "camera.landmarks beside it"),
        ("inspection", ["camera.landmarks=nowhere.safetensors"], "camera.landmarks", "'none', 'packaged' or the path"),
        ("cooperative_inspection", [ON], "camera.landmarks", "a scenario of one servicer"),
        (
            "pose_inspection",
            ["landmarks.miss_probability=1.1"],
            "landmarks.miss_probability",
            "less than or equal to 1",
        ),
        ("pose_inspection", ["landmarks.minimum_size_px=0"], "landmarks.minimum_size_px", "greater than 0"),
        ("pose_inspection", ["landmarks.believed_noise_factor=0"], "landmarks.believed_noise_factor", "greater than 0"),
        ("pose_inspection", ["landmarks.body_offset_m=[0.0, 0.0]"], "landmarks.body_offset_m", "at least 3 numbers"),
    ],
)
def test_bad_landmarks_are_refused_in_one_line(scenario: str, changes: list[str], key: str, words: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        rpojax.load(scenario, changes)
    assert_one_line(refused.value, key, words)


@pytest.mark.parametrize(("factor", "fits"), [(0.8, False), (0.95, True), (1.05, True), (1.25, False)])
def test_landmarks_of_another_target_are_refused(tmp_path: Path, factor: float, fits: bool) -> None:
    override = file_of(tmp_path, enlarged(factor))
    if fits:
        assert rpojax.load("inspection", [override]).landmarks is not None
        return
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("inspection", [override])
    assert_one_line(refused.value, "camera.landmarks", "those of the target, whose hull reaches")


def test_too_many_landmarks_are_refused(tmp_path: Path) -> None:
    packaged = load_landmarks()[0]
    chosen = np.arange(MOST + 1) % packaged.positions.shape[0]
    many = replace(
        packaged,
        positions=packaged.positions[chosen],
        normals=packaged.normals[chosen],
        visible=packaged.visible[:, chosen],
        permutations=np.arange(MOST + 1, dtype=np.int32)[None],
    )
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("inspection", [file_of(tmp_path, many)])
    assert_one_line(refused.value, "camera.landmarks", f"at most {MOST} landmarks")


def test_a_file_of_another_kind_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "own.safetensors"
    path.write_bytes(b"no landmarks")
    with pytest.raises(RpojaxError, match=r"^[^\n]*own\.safetensors[^\n]*$"):
        rpojax.load("inspection", [f"camera.landmarks={path}"])


def test_a_scenario_with_landmarks_has_their_section_and_one_without_has_none() -> None:
    assert rpojax.load("inspection").landmarks is None
    file = rpojax.load("inspection", [ON])
    assert file.landmarks is not None
    assert file.landmarks == rpojax.load("pose_inspection").landmarks
    assert rpojax.load("inspection", [ON, "landmarks.noise_px=2.0"]).landmarks.noise_px == 2.0  # type: ignore[union-attr]
    assert scenario_loader.validate(file.model_dump(mode="json")) == file


def test_flight_software_has_the_nominal_target() -> None:
    file = rpojax.load("inspection", [ON])
    made = params.build_params(file.model_dump(), file.camera.width_px, file.camera.height_px)
    assert made.landmarks is not None
    assert made.flight.target is not None
    np.testing.assert_array_equal(made.flight.target.landmarks, made.landmarks.positions)
    np.testing.assert_array_equal(made.flight.target.inertia, file.target.inertia_kg_m2)
    assert set(made.flight.sensors["landmarks"]) == {"believed_noise_factor"}
    assert params.leaf_path_and_factor("landmarks.noise_px")[0] == ("additional_sensors", "landmarks", "noise")
    without = params.build_params(rpojax.load("inspection").model_dump(), 128, 128)
    assert without.landmarks is None and without.flight.target is None
