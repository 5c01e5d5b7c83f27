"""Scale of the target: every camera sees a larger target as the nominal one from nearer by."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.orbits.sun_moon_ephemeris import sun_and_moon_at
from rpojax.core.pytree import replace
from rpojax.physics import equipment_faults
from rpojax.scenario import params
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.static_settings import Scenario, static_settings
from rpojax.scenario.trained import fitted_camera
from rpojax.sensors.camera import CameraFrame
from rpojax.simulation import camera_models, initial_state
from rpojax.simulation.noise import camera_key, draw_tick_noise, run_key
from rpojax.simulation.state import State

SMALL = ["camera.width_px=64", "camera.height_px=64", "camera.field_of_view_deg=5.0"]
NEAR = ["initial.relative_position_m=[0.0, -30.0, 0.0]", "navigation.initial_relative_position_sigma_m=0.2"]
SCALE = 1.5


init = jax.jit(initial_state.init, static_argnums=0)


@partial(jax.jit, static_argnums=0)
def expose(
    static: Scenario, scaled: params.Params, start: State, farther: jax.Array
) -> tuple[CameraFrame, jax.Array | None]:
    """Frame, and image if it is rendered, at the start, but from a range that is larger by a factor."""
    truth, command = replace(start.truth, r_ST_N=farther * start.truth.r_ST_N), start.flight.camera
    errors, at = start.sensor_errors.box_edge_errors, start.tick
    sky, noise = sun_and_moon_at(scaled.epoch, jnp.zeros(())), draw_tick_noise(static, start.keys, at)
    health, key = equipment_faults.healthy(), camera_key(start.keys, at)
    return camera_models.expose(static, scaled, truth, command, errors, sky, health, noise, key, at)


def frame_and_picture(model: str, scale: float, farther: float) -> tuple[CameraFrame, np.ndarray | None]:
    """Frame, and image if it is rendered, of a target of a scale at `farther` times 30 m."""
    small = SMALL if model == "rendered" else []
    file = scenario_loader.load("inspection", [*small, *NEAR, f"camera.model={model}"])
    static = static_settings(file)
    nominal = params.build_params(file.model_dump(), static.width_px, static.height_px)
    start = init(static, nominal, run_key(0, 0))
    scaled = params.replace_leaf(nominal, ("plant", "target", "scale"), jnp.asarray(scale))
    frame, picture = expose(static, scaled, start, jnp.asarray(farther))
    return jax.device_get(frame), None if picture is None else np.asarray(picture)


@pytest.mark.parametrize("model", ["geometric", "statistical", "rendered"])
def test_a_larger_target_looks_as_the_nominal_one_from_nearer_by(model: str) -> None:
    near, near_picture = frame_and_picture(model, 1.0, 1.0)
    far, far_picture = frame_and_picture(model, SCALE, SCALE)
    assert float(near.outline[2] - near.outline[0]) > 5.0
    # Rounding of the projection; single precision of views for the networks.
    tolerance = 1e-9 if model == "geometric" else 1e-2
    np.testing.assert_allclose(far.outline, near.outline, rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(far.box.edges, near.box.edges, rtol=0.0, atol=tolerance)
    assert bool(far.box.present) == bool(near.box.present)
    if near_picture is not None and far_picture is not None:
        # One step of 256 grey levels, and two at the border of a ray's cell.
        assert np.abs(far_picture - near_picture).mean() < 1e-3


def test_the_image_of_a_larger_target_fills_its_true_outline() -> None:
    frame, picture = frame_and_picture("rendered", SCALE, 1.0)
    nominal, _ = frame_and_picture("rendered", 1.0, 1.0)
    assert picture is not None
    sides = frame.outline[2:] - frame.outline[:2]
    # Perspective changes the ratio by some percent.
    np.testing.assert_allclose(sides / (nominal.outline[2:] - nominal.outline[:2]), SCALE, rtol=0.05)
    lit = picture.max(axis=2) > 0.25
    rows, columns = np.flatnonzero(lit.any(axis=1)), np.flatnonzero(lit.any(axis=0))
    seen = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
    # Blur and parts in shadow move an edge of the lit pixels by a pixel or two.
    np.testing.assert_allclose(seen, frame.outline, atol=3.0)


def test_networks_and_statistics_of_a_larger_target_serve_greater_ranges() -> None:
    tables = scenario_loader.load("inspection").model_dump()
    tables["target"]["scale"] = 2.0
    near, far = fitted_camera.view_limits(tables)[fitted_camera.RANGE_KEY]
    assert (near, far) == (15.0, 25.0)
