"""Validity of fitted camera statistics for a scenario."""

from pathlib import Path

import pytest

from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.trained import fitted_camera, trained_files
from rpojax.sensors import statistical_camera_file
from rpojax.sensors.statistical_camera import CameraStatistics
from rpojax.vision.radiance_field import field_file


def test_statistics_fitted_for_other_settings_are_refused() -> None:
    with pytest.raises(ScenarioError, match="calibrate-camera-model") as error:
        tables = scenario_loader.load(
            "inspection", ["camera.model=statistical", "camera.field_of_view_deg=20.0"]
        ).model_dump()
        fitted_camera.statistics_for_model(tables)
    assert "camera.field_of_view_deg" in str(error.value)
    assert "\n" not in str(error.value)


def test_the_packaged_statistics_fit_the_packaged_scenario() -> None:
    file = scenario_loader.load("inspection", ["camera.model=statistical"])
    found = fitted_camera.statistics_for_model(file.model_dump())
    assert isinstance(found, CameraStatistics)
    _, card = statistical_camera_file.load_statistics(trained_files.file_path(file.model_dump(), "statistics"))
    assert card["made_with"] == {
        "imaging.field": trained_files.file_digest(field_file.packaged_field_path()),
        "imaging.detector": trained_files.file_digest(trained_files.file_path(file.model_dump(), "detector")),
    }


def test_ranges_are_those_of_start_station_and_phases_through_each_lens() -> None:
    inspection = scenario_loader.load("inspection").model_dump()
    assert fitted_camera.ranges_in_use(inspection) == (30.0, 50.0)
    approach = scenario_loader.load("final_approach").model_dump()
    assert fitted_camera.ranges_in_use(approach) == (12.0, 100.0)
    assert fitted_camera.ranges_in_use(approach, through_wide_lens=True) == (3.0, 15.0)
    capture = scenario_loader.load("capture").model_dump()
    assert fitted_camera.ranges_in_use(capture, through_wide_lens=True) == (1.5, 15.0)
    assert fitted_camera.ranges_in_use(scenario_loader.load("fly_around").model_dump()) == (30.0, 45.0)


def test_statistics_of_another_detector_or_smaller_range_of_views_are_refused(tmp_path: Path) -> None:
    other = tmp_path / "other.safetensors"
    other.write_bytes(b"another detector")
    for change, words in (
        (f"imaging.detector='{other}'", "imaging.detector"),
        ("formation.desired_position_m=[0.0, -300.0, 0.0]", "range of start and station"),
        ("camera.phase_limit_deg=170.0", "camera.phase_limit_deg"),
    ):
        tables = scenario_loader.load("inspection", ["camera.model=statistical", change]).model_dump()
        with pytest.raises(ScenarioError, match="calibrate-camera-model") as error:
            fitted_camera.statistics_for_model(tables)
        assert words in str(error.value)
