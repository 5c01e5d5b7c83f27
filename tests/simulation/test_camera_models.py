"""Frames by the light of the lamp, and through the second lens."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import rpojax
from rpojax.core.numerics.gradient_safe import normalize
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions, sun_and_moon_at
from rpojax.core.pytree import replace
from rpojax.flight.guidance.lens_choice import LensInUse
from rpojax.physics import equipment_faults
from rpojax.scenario import params
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario, static_settings
from rpojax.sensors.camera import CameraFrame, WideLens
from rpojax.simulation import camera_models, initial_state, tick_measurements
from rpojax.simulation.noise import camera_key, draw_tick_noise, run_key
from rpojax.simulation.state import State
from tests.sensors.synthetic_camera_statistics import fitted

LAMP = ["lamp.reach_m=60", "lamp.beam_half_angle_deg=20", "lamp.boresight=[1.0, 0.0, 0.0]"]
SURE = ["camera.miss_probability=0", "camera.outlier_probability=0"]
init = jax.jit(initial_state.init, static_argnums=0)


@partial(jax.jit, static_argnums=0)
def expose(static: Scenario, run: Params, start: State, sky: SunMoonPositions) -> CameraFrame:
    """Frame at the start."""
    noise, key = draw_tick_noise(static, start.keys, start.tick), camera_key(start.keys, start.tick)
    return camera_models.expose(
        static,
        run,
        start.truth,
        start.flight.camera,
        start.sensor_errors.box_edge_errors,
        sky,
        equipment_faults.healthy(),
        noise,
        key,
        start.tick,
    )[0]


def scene(model: str, *changes: str) -> tuple[Scenario, Params, State, SunMoonPositions]:
    """A run at its start, under the Sun of its date."""
    file = rpojax.load("inspection", [f"camera.model={model}", "dispersions=[]", *SURE, *changes])
    static = static_settings(file)
    run = params.build_params(file.model_dump(), static.width_px, static.height_px)
    return static, run, init(static, run, run_key(0, 0)), jax.jit(sun_and_moon_at)(run.epoch, jnp.zeros(()))


def in_the_shadow(start: State, sky: SunMoonPositions) -> SunMoonPositions:
    """The Sun behind the Earth, as the target sees it."""
    return replace(sky, sun_N=-1.496e11 * normalize(start.truth.r_TN_N))


@pytest.mark.parametrize("model", ["geometric", "statistical"])
def test_the_target_is_seen_in_the_shadow_by_the_lamp_alone(model: str) -> None:
    static, run, start, sky = scene(model)
    assert bool(expose(static, run, start, sky).observable)
    dark = in_the_shadow(start, sky)
    assert not bool(expose(static, run, start, dark).observable)
    static, run, start, _ = scene(model, *LAMP)
    assert run.lamp is not None
    assert bool(expose(static, run, start, dark).observable)
    weaker = replace(run, lamp=replace(run.lamp, reach=jnp.float64(20.0)))
    frame = expose(static, weaker, start, dark)
    assert not bool(frame.observable)
    assert not bool(frame.box.present)


def test_a_frame_in_sunlight_is_the_same_with_a_lamp() -> None:
    static, run, start, sky = scene("statistical")
    expected = expose(static, run, start, sky)
    static, run, start, sky = scene("statistical", *LAMP)
    jax.tree.map(np.testing.assert_array_equal, expose(static, run, start, sky), expected)


def test_statistics_under_the_lamp_are_those_of_a_sun_behind_the_camera() -> None:
    static, run, start, sky = scene("statistical", *LAMP)
    dark = in_the_shadow(start, sky)
    by_lamp = camera_models._under_the_lamp(
        camera_models._scene(static, run, start.truth, dark, start.tick), jnp.asarray(True)
    )
    lit = replace(sky, sun_N=1.496e11 * normalize(start.truth.r_ST_N))
    by_sun = camera_models._scene(static, run, start.truth, lit, start.tick)
    np.testing.assert_allclose(by_lamp.sun_T, by_sun.sun_T, atol=1e-6)
    assert float(by_lamp.sunlight) == 1.0
    # The ground below is as dark as it was.
    np.testing.assert_array_equal(by_lamp.sun_N, normalize(dark.sun_N).astype(jnp.float32))


LENS = ["wide_lens.field_of_view_deg=25", "wide_lens.switch_range_m=32", "wide_lens.return_range_m=36"]
OTHER = ["wide_lens.edge_noise_px=3", "wide_lens.misalignment_deg=[0.3, -0.2, 0.1]"]


def test_a_frame_through_a_lens_is_that_of_a_camera_with_it_alone() -> None:
    misalignment = rpojax.load("inspection").camera.misalignment_deg
    both = [one + other for one, other in zip(misalignment, (0.3, -0.2, 0.1), strict=True)]
    wide_alone = ["camera.field_of_view_deg=25", "camera.edge_noise_px=3", f"camera.misalignment_deg={both}"]
    static, run, start, sky = scene("geometric", *LENS, *OTHER)
    for is_wide, alone in ((True, wide_alone), (False, [])):
        lens = LensInUse(is_wide=jnp.asarray(is_wide), was_wide=jnp.asarray(False))
        found = expose(static, run.seen_through(lens), start, sky)
        own_static, own_run, own_start, _ = scene("geometric", *alone)
        expected = expose(own_static, own_run, replace(own_start, truth=start.truth), sky)
        assert bool(found.box.present)
        for one, other in ((found.outline, expected.outline), (found.box.edges, expected.box.edges)):
            np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9)


def test_boxes_are_measured_with_the_lens_that_flight_software_chose() -> None:
    static, run, start, sky = scene("geometric", *LENS, "wide_lens.edge_noise_px=0", "camera.edge_noise_px=0")
    tangents = []
    for is_wide in (True, False):
        lens = LensInUse(is_wide=jnp.asarray(is_wide), was_wide=jnp.asarray(False))
        through = run.seen_through(lens)
        frame = expose(static, through, start, sky)
        tangents.append(np.asarray(tick_measurements.box_measurement(static, through, frame).tangent))
        assert float(through.flight.vehicle.focal_px) == pytest.approx(
            0.5 * static.width_px / np.tan(0.5 * float(through.camera.field_of_view)), rel=1e-12
        )
    np.testing.assert_allclose(tangents[0], tangents[1], atol=1e-12)


def test_statistics_are_those_of_the_lens_in_use() -> None:
    static, run, start, sky = scene("statistical")
    assert run.statistics is not None
    wide = WideLens(field_of_view=run.camera.field_of_view, misalignment=jnp.zeros(3))
    two = replace(run, wide_lens=wide, wide_statistics=fitted(true=0.0001, false=0.0))
    wide_in_use, own_in_use = (
        two.seen_through(LensInUse(is_wide=jnp.asarray(each), was_wide=jnp.asarray(False))) for each in (True, False)
    )
    expected = expose(static, run, start, sky)
    assert bool(expected.box.present)
    jax.tree.map(np.testing.assert_array_equal, expose(static, own_in_use, start, sky), expected)
    assert not bool(expose(static, wide_in_use, start, sky).box.present)
