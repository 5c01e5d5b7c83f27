"""The camera models of the loop: pictures whose boxes are of the target, and files that fit the scenario."""

from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np
import pytest

from rpojax.errors import ScenarioError
from rpojax.flight.computer import Stages
from rpojax.scenario import params
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.static_settings import static_settings
from rpojax.scenario.trained import fitted_camera, trained_files
from rpojax.sensors import statistical_camera_file
from rpojax.sensors.statistical_camera import CameraStatistics
from rpojax.simulation import initial_state
from rpojax.simulation.channels import Channels, compute_channels
from rpojax.simulation.noise import run_key
from rpojax.simulation.state import State
from rpojax.simulation.step import step
from rpojax.vision.radiance_field import field_file

SMALL = ["camera.width_px=64", "camera.height_px=64", "camera.field_of_view_deg=5.0", "dispersions=[]"]
POINTED = "navigation.initial_relative_position_sigma_m=0.2"
TICKS = 12


def flown(overrides: Sequence[str]) -> Channels:
    """Channels of the first ticks of a run."""
    file = scenario_loader.load("inspection", overrides)
    static = static_settings(file)
    numbers = params.build_params(file.model_dump(), static.width_px, static.height_px)
    state = initial_state.init(static, numbers, run_key(0, 0))

    @jax.jit
    def run(numbers: params.Params, state: State) -> Channels:
        def one(state: State, _: None) -> tuple[State, Channels]:
            after, seen = step(static, numbers, state, Stages())
            return after, compute_channels(static, numbers, seen)

        return jax.lax.scan(one, state, None, length=TICKS)[1]

    return jax.tree.map(np.asarray, run(numbers, state))


@pytest.fixture(scope="module")
def rendered() -> Channels:
    """A run whose camera takes pictures, the Sun at its back."""
    return flown([*SMALL, POINTED, "camera.model=rendered", "initial.relative_position_m=[0.0, -30.0, 0.0]"])


def test_boxes_found_in_pictures_are_of_the_target(rendered: Channels) -> None:
    assert rendered["observable"].all()
    present = rendered["box_present"]
    assert present.mean() > 0.8
    assert not rendered["box_outlier"].any()
    # 1.6 m at 30 m through 733 px of focal length are 39 px at most, and the box of a tumbling target half of that.
    sides = rendered["box_px"][present][:, 2:]
    assert 8.0 < np.median(np.sqrt(np.prod(sides, axis=1))) < 40.0


def test_flight_software_flies_by_boxes_from_pictures(rendered: Channels) -> None:
    assert rendered["box_accepted"].mean() > 0.6
    assert np.linalg.norm(rendered["relative_error_H"], axis=1).max() < 10.0


def test_the_fitted_camera_must_fit_the_scenario() -> None:
    with pytest.raises(ScenarioError, match="calibrate-camera-model") as error:
        tables = scenario_loader.load(
            "inspection", ["camera.model=statistical", "camera.field_of_view_deg=20.0"]
        ).model_dump()
        fitted_camera.statistics_for_model(tables)
    assert "camera.field_of_view_deg" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("key", ["field", "detector"])
def test_a_trained_file_that_is_not_there_is_named(key: str) -> None:
    file = scenario_loader.load("inspection", ["camera.model=rendered", f"imaging.{key}=/nowhere/x.safetensors"])
    with pytest.raises(ScenarioError, match=f"imaging.{key}"):
        trained_files.networks_for_model(file.model_dump())


def test_other_trained_files_make_another_scenario(tmp_path: Path) -> None:
    copy = tmp_path / "other.safetensors"
    copy.write_bytes(field_file.packaged_field_path().read_bytes() + b" ")
    one = scenario_loader.load("inspection", ["camera.model=rendered"])
    other = scenario_loader.load("inspection", ["camera.model=rendered", f"imaging.field={copy}"])
    assert scenario_digest(one) != scenario_digest(other)


def test_paths_of_trained_files_start_from_the_scenarios_folder(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('extends = "inspection"\n[imaging]\nfield = "my.field.safetensors"\n')
    file = scenario_loader.load(tmp_path / "mine.toml")
    assert Path(file.imaging.field) == (tmp_path / "my.field.safetensors").resolve()


def test_the_packaged_fitted_camera_fits_the_packaged_scenario() -> None:
    file = scenario_loader.load("inspection", ["camera.model=statistical"])
    found = fitted_camera.statistics_for_model(file.model_dump())
    assert isinstance(found, CameraStatistics)
    _, card = statistical_camera_file.load_statistics(trained_files.file_path(file.model_dump(), "statistics"))
    assert card["made_with"] == {
        "imaging.field": trained_files.file_digest(field_file.packaged_field_path()),
        "imaging.detector": trained_files.file_digest(trained_files.file_path(file.model_dump(), "detector")),
    }


def test_a_fitted_camera_is_refused_with_another_detector_or_beyond_its_views(tmp_path: Path) -> None:
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
