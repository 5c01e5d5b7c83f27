"""Look attitude: camera on the target, roll towards the orbit normal, and its rate."""

import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from hypothesis import given
from numpy_reference import (
    MU,
    SEEDS,
    random_unit,
    rate_between,
    rotation_matrix,
    unit,
)
from simulated_guidance import TIME, YES, boresight, guide, look_attitude, plan, push_gently

from rpojax.core.pytree import replace
from rpojax.flight.guidance import attitude_guidance
from rpojax.flight.guidance.attitude_guidance import GuidanceTick
from rpojax.flight.guidance.line_of_sight_uncertainty import is_within_frame
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.flight.guidance.target_acquisition import Sighting
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.scenario.params import Params

EXACT = 1e-12  # roundings of unit vectors and angles


@given(SEEDS)
def test_the_camera_points_at_the_target_with_its_x_axis_towards_the_orbit_normal(params: Params, seed: int) -> None:
    direction = random_unit(np.random.default_rng(seed))
    known = rendezvous_scene.estimate(params.flight, 40.0 * direction)
    q_BN, _ = look_attitude(params.flight.vehicle, known)
    q_KN = rendezvous_scene.camera_attitude(params.flight, known)
    R_KN = rotation_matrix(q_KN)
    np.testing.assert_allclose(R_KN[2], direction, atol=EXACT)
    normal = unit(np.cross(rendezvous_scene.R_SN_N, rendezvous_scene.V_SN_N))
    np.testing.assert_allclose(R_KN[0] @ normal, np.sqrt(1.0 - (normal @ direction) ** 2), atol=1e-9)
    np.testing.assert_allclose(boresight(params.flight, q_BN), direction, atol=EXACT)


@given(SEEDS)
def test_the_look_rate_is_the_derivative_of_the_look_attitude(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    normal = unit(np.cross(rendezvous_scene.R_SN_N, rendezvous_scene.V_SN_N))
    line = unit(np.cross(normal, random_unit(rng)) + 0.7 * rng.uniform(-1, 1) * normal)
    r, v, h = 30.0 * line, 0.1 * rng.normal(size=3), 0.01
    gravity = -MU * rendezvous_scene.R_SN_N / np.linalg.norm(rendezvous_scene.R_SN_N) ** 3

    def at(t: float) -> OrbitEstimate:
        known = rendezvous_scene.estimate(params.flight, r + t * v, v)
        moved = replace(
            known.servicer,
            r_SN_N=rendezvous_scene.R_SN_N + t * rendezvous_scene.V_SN_N + 0.5 * t * t * gravity,
            v_SN_N=rendezvous_scene.V_SN_N + t * gravity,
        )
        return replace(known, servicer=moved)

    (before, _), (_, omega), (after, _) = (look_attitude(params.flight.vehicle, at(t)) for t in (-h, 0.0, h))
    expected = rate_between(np.asarray(before), np.asarray(after), 2 * h)
    np.testing.assert_allclose(omega, expected, atol=1e-8)  # truncation h^2 times the cube of a rate of 6e-3 rad/s


@given(SEEDS)
def test_near_the_orbit_normal_the_camera_hardly_turns_about_its_axis(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    normal = unit(np.cross(rendezvous_scene.R_SN_N, rendezvous_scene.V_SN_N))
    # Errors of the estimate of 3 mm at 30 m, about a target exactly along the normal.
    lines = [unit(normal + 1e-4 * rng.normal(size=3)) for _ in range(2)]
    first, second = (rendezvous_scene.estimate(params.flight, 30.0 * line) for line in lines)
    q_before = random_unit(rng, 4)
    q_first, _ = look_attitude(params.flight.vehicle, first, q_before)
    q_second, omega = look_attitude(params.flight.vehicle, second, q_first)
    np.testing.assert_allclose(boresight(params.flight, q_second), lines[1], atol=1e-9)
    turned = rate_between(np.asarray(q_first), np.asarray(q_second), 1.0)
    assert np.linalg.norm(turned) <= np.linalg.norm(lines[1] - lines[0]) + 1e-9
    assert abs(np.asarray(omega)[0]) < EXACT  # the boresight is body x


@given(SEEDS)
def test_far_from_the_orbit_normal_the_attitude_before_does_not_matter(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    normal = unit(np.cross(rendezvous_scene.R_SN_N, rendezvous_scene.V_SN_N))
    line = unit(unit(np.cross(normal, random_unit(rng))) + rng.uniform(-5.0, 5.0) * normal)
    known = rendezvous_scene.estimate(params.flight, 30.0 * line)
    for after, alone in zip(
        look_attitude(params.flight.vehicle, known, random_unit(rng, 4)),
        look_attitude(params.flight.vehicle, known),
        strict=True,
    ):
        np.testing.assert_allclose(after, alone, atol=EXACT)


def test_along_the_orbit_normal_itself_there_is_an_attitude_without_roll_rate(params: Params) -> None:
    normal = unit(np.cross(rendezvous_scene.R_SN_N, rendezvous_scene.V_SN_N))
    known = rendezvous_scene.estimate(params.flight, 30.0 * normal, np.array([0.01, 0.02, -0.01]))
    q_BN, omega = look_attitude(params.flight.vehicle, known)
    np.testing.assert_allclose(np.linalg.norm(q_BN), 1.0, atol=EXACT)
    np.testing.assert_allclose(boresight(params.flight, q_BN), normal, atol=1e-9)
    assert np.linalg.norm(omega) < 0.03 / 30.0  # that of the line of sight


def test_guidance_near_the_orbit_normal_begins_no_slew_though_the_estimate_is_noisy(params: Params) -> None:
    rng = np.random.default_rng(1)
    flight = params.flight
    normal = unit(np.cross(rendezvous_scene.R_SN_N, rendezvous_scene.V_SN_N))

    def noisy() -> OrbitEstimate:
        return rendezvous_scene.estimate(flight, 30.0 * normal + 0.01 * rng.normal(size=3))

    first = noisy()
    state = attitude_guidance.initial_pointing(flight.vehicle, first)
    none = plan(push_gently, flight, first, False)
    for tick in range(20):
        inputs = GuidanceTick(
            time=TIME + tick, estimate=noisy(), plan=none, sighting=Sighting(seen=YES, promising=YES), visible=YES
        )
        state, mode = guide(flight, state, inputs)
        assert int(mode) == Mode.LOOK
    assert float(state.reference.slew_age) >= 20.0


@pytest.mark.parametrize(("offset", "fits"), [(0.9, True), (1.1, False)])
def test_a_frame_holds_the_uncertainty_up_to_half_of_its_angle(params: Params, offset: float, fits: bool) -> None:
    known = rendezvous_scene.estimate(params.flight, np.array([30.0, 0.0, 0.0]))
    covariance = 1e-12 * np.eye(12)
    half_angle = np.radians(5.0)
    covariance[1, 1] = (offset * half_angle * 30.0 / 3.0) ** 2
    known = replace(known, relative=replace(known.relative, covariance=jnp.asarray(covariance)))
    half_frame = jnp.array([np.tan(half_angle), 2.0 * np.tan(half_angle)])
    assert bool(is_within_frame(known, jnp.asarray(3.0), half_frame)) == fits
