"""Lasting errors of statistical landmarks change as the target turns before the camera, wherever the camera points."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax import nominal_parameters
from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.errors import ScenarioError
from rpojax.physics import plant_state
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.trained import fitted_camera
from rpojax.simulation.tick_measurements import turn_rate_before_camera
from rpojax.vision.surface import landmark_file


def truth(omega_TN_T: np.ndarray, v_ST_N: np.ndarray, omega_BN_B: np.ndarray) -> plant_state.Truth:
    params = nominal_parameters(scenario_loader.load("pose_inspection"))[1]
    start, identity = params.initial, jnp.array([1.0, 0.0, 0.0, 0.0])
    made = plant_state.initial_truth(
        params.plant, params.orbit, start.relative_position, start.relative_velocity, identity
    )
    q_TN = quaternion.normalize(jnp.array([0.5, 0.4, -0.6, 0.3]))
    return replace(
        made,
        r_ST_N=jnp.array([0.0, -10.0, 0.0]),
        v_ST_N=jnp.asarray(v_ST_N),
        q_TN=q_TN,
        omega_TN_T=quaternion.rotate(q_TN, jnp.asarray(omega_TN_T)),
        omega_BN_B=jnp.asarray(omega_BN_B),
    )


def test_the_view_turns_by_the_target_less_the_line_of_sight() -> None:
    about_z, none = np.array([0.0, 0.0, 0.02]), np.zeros(3)
    # At 10 m below it in y a servicer that turns with the target moves along x.
    along = np.cross(about_z, [0.0, -10.0, 0.0])
    assert float(turn_rate_before_camera(truth(about_z, along, none))) == pytest.approx(0.0, abs=1e-15)
    assert float(turn_rate_before_camera(truth(about_z, none, none))) == pytest.approx(0.02)
    assert float(turn_rate_before_camera(truth(none, along, none))) == pytest.approx(0.02)
    assert float(turn_rate_before_camera(truth(none, none, np.array([0.1, 0.0, 0.0])))) == 0.0


def test_statistics_of_other_landmarks_are_refused(tmp_path: Path) -> None:
    packaged, _ = landmark_file.load_landmarks(None)
    other = replace(packaged, positions=packaged.positions * jnp.array([[-1.0, 1.0, 1.0]]))
    path = tmp_path / "own.landmarks.safetensors"
    landmark_file.save_landmarks(other, path, {})
    tables = scenario_loader.load("pose_inspection", ["camera.model=statistical"]).model_dump()
    assert fitted_camera.statistics_for_model(tables) is not None
    tables["camera"]["landmarks"] = str(path)
    with pytest.raises(ScenarioError, match=r"camera\.landmarks: found .*calibrate-camera-model") as refused:
        fitted_camera.statistics_for_model(tables)
    assert "\n" not in str(refused.value)
