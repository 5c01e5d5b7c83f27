"""Burn planning: predicted deviation, times, attitude, conditions for a burn, and inhibition of thrust."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from hypothesis import given
from numpy_reference import (
    SEEDS,
    attitude_difference,
    axis_angle_quaternion,
    gravity,
    rotation_matrix,
    unit,
)
from scipy.integrate import solve_ivp
from simulated_guidance import TIME, guidance_of, look_attitude, plan, push_back, push_gently, push_hard

from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import burn_schedule
from rpojax.flight.guidance.burn_schedule import BurnPlan
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.scenario.params import Params

hill = jax.jit(hill_frame)


@jax.jit
def inhibit(flight: FlightParams, plan: BurnPlan, q_BN: jax.Array, time: jax.Array) -> BurnPlan:
    return burn_schedule.inhibit(guidance_of(flight), plan, q_BN, time)


to_hill = jax.jit(inertial_to_hill)
OFFSET = np.array([0.01, 0.0, 0.0])
"""Offset of the two laws below, above the dead band [m/s]."""


def report_position(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """Law that returns the predicted position deviation: a millimetre per second for each metre."""
    return OFFSET + 1e-3 * deviation[:3]


def report_velocity(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """Law that returns the predicted velocity deviation."""
    return OFFSET + deviation[3:]


def push_briefly(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """1.1 mm/s, just outside of it."""
    return jnp.array([0.0, 1.1e-3, 0.0])


@given(SEEDS)
def test_the_deviation_is_predicted_to_the_middle_of_the_burn_in_the_hill_frame_there(
    params: Params, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    flight = params.flight
    r_TS_N, v_TS_N = (
        rendezvous_scene.TARGET_AHEAD + 3.0 * rng.normal(size=3),
        np.cross(rendezvous_scene.HILL_RATE, rendezvous_scene.TARGET_AHEAD),
    )
    v_TS_N = v_TS_N + 0.01 * rng.normal(size=3)
    known = rendezvous_scene.estimate(flight, r_TS_N, v_TS_N)
    lead = 60.0
    orbits = []
    for start in (
        np.concatenate([rendezvous_scene.R_SN_N, rendezvous_scene.V_SN_N]),
        np.concatenate([rendezvous_scene.R_SN_N + r_TS_N, rendezvous_scene.V_SN_N + v_TS_N]),
    ):
        solution = solve_ivp(
            lambda _, y: np.concatenate([y[3:], gravity(y[:3])]), (0.0, lead), start, "DOP853", rtol=1e-13, atol=1e-8
        )
        orbits.append(solution.y[:, -1])
    servicer, target = orbits
    axes = hill(target[:3], target[3:])
    rho, rho_dot = to_hill((servicer - target)[:3], (servicer - target)[3:], *axes)
    # The circular-orbit model over a minute leaves out J2 and eccentricity: 1e-3 of the 30 m times (n 60 s)^2.
    for law, scale, expected, bound in (
        (report_position, 1e-3, np.asarray(rho) - [0.0, -30.0, 0.0], 2e-3),
        (report_velocity, 1.0, np.asarray(rho_dot), 1e-4),
    ):
        found = (np.asarray(axes[0]) @ plan(law, flight, known).delta_v_N - OFFSET) / scale
        np.testing.assert_allclose(found, expected, atol=bound)


def test_the_burn_is_centred_on_the_lead_and_lasts_as_long_as_its_velocity_change_takes(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    found = plan(push_back, flight, known)
    np.testing.assert_allclose(found.cutoff - found.ignition, 20.0, rtol=1e-12)  # 20 mm/s at 1 mm/s^2
    np.testing.assert_allclose(0.5 * (found.cutoff + found.ignition), TIME + 60.0, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.delta_v_N), 0.02, rtol=1e-12)


@given(SEEDS)
def test_the_burn_attitude_puts_the_thrust_along_the_velocity_change(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    r_TS_N = rendezvous_scene.TARGET_AHEAD + 5.0 * rng.normal(size=3)
    found = plan(report_position, params.flight, rendezvous_scene.estimate(params.flight, r_TS_N))
    thrust = rotation_matrix(found.q_burn).T @ np.asarray(params.flight.vehicle.thrust_direction)
    np.testing.assert_allclose(thrust, unit(found.delta_v_N), atol=1e-9)


@given(SEEDS)
def test_the_turn_is_over_before_the_attitude_is_checked_at_any_rate_of_guidance(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    flight, dt = params.flight, float(rng.choice([0.2, 1.0, 2.0, 5.0]))
    r_TS_N = rendezvous_scene.TARGET_AHEAD + 5.0 * rng.normal(size=3)
    estimate = rendezvous_scene.estimate(flight, r_TS_N)
    found = plan(report_position, flight, estimate, dt=dt)
    q_look = np.asarray(look_attitude(flight.vehicle, estimate)[0])
    angle = attitude_difference(q_look, np.asarray(found.q_burn))
    turn = max(np.sqrt(2.0 * np.pi * angle / float(flight.pointing.slew_acceleration)), 6.0)
    # Ticks of guidance count from the decision: the turn begins on the first one after its planned start, and the
    # attitude is checked on the last one before ignition.
    begin = dt * np.ceil((found.turn_start - TIME) / dt - 1e-6)
    check = dt * np.floor((found.ignition - TIME) / dt)
    assert found.cutoff > found.ignition
    assert begin + turn <= check
    assert check + dt > found.ignition - TIME


def assert_no_burn(found: BurnPlan) -> None:
    assert found.cutoff == found.ignition
    np.testing.assert_array_equal(found.delta_v_N, np.zeros(3))
    assert found.turn_start == found.ignition


def test_there_is_no_burn_in_the_dead_band(flight: FlightParams, known: OrbitEstimate) -> None:
    assert_no_burn(plan(push_gently, flight, known))
    assert plan(push_briefly, flight, known).cutoff > plan(push_briefly, flight, known).ignition


def test_there_is_no_burn_unless_allowed(flight: FlightParams, known: OrbitEstimate) -> None:
    assert_no_burn(plan(push_back, flight, known, allowed=False))


def test_there_is_no_burn_shorter_than_the_thrusters_least_on_time(flight: FlightParams, known: OrbitEstimate) -> None:
    slow = replace(flight, vehicle=replace(flight.vehicle, minimum_on_time=jnp.float64(1.2)))
    assert_no_burn(plan(push_briefly, slow, known))


def test_a_burn_too_long_for_the_limit_is_shortened(flight: FlightParams, known: OrbitEstimate) -> None:
    found = plan(push_hard, flight, known)
    np.testing.assert_allclose(np.linalg.norm(found.delta_v_N), 1e-3 * (found.cutoff - found.ignition), rtol=1e-12)
    assert 20.0 < found.cutoff - found.ignition < 110.0


@pytest.mark.parametrize(("degrees", "fired"), [(0.1, True), (2.9, True), (3.1, False), (5.0, False), (180.0, False)])
def test_thrust_is_inhibited_beyond_the_attitude_limit(
    flight: FlightParams, known: OrbitEstimate, degrees: float, fired: bool
) -> None:
    found = plan(push_back, flight, known)
    off = axis_angle_quaternion([0.3, -0.5, 0.8], np.deg2rad(degrees))
    q_BN = np.asarray(rendezvous_scene.quaternion.multiply(jnp.asarray(off), jnp.asarray(found.q_burn)))
    for sign in (1.0, -1.0):
        after = inhibit(flight, found, sign * q_BN, found.ignition - 0.5)
        assert (float(after.cutoff) > float(after.ignition)) is fired
    if fired:
        jax.tree.map(np.testing.assert_array_equal, after, found)


def test_inhibition_during_a_burn_keeps_the_past_thrust_and_stops_the_rest(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    found = plan(push_back, flight, known)
    tumbling = np.asarray(
        rendezvous_scene.quaternion.multiply(
            jnp.asarray(axis_angle_quaternion([0.0, 0.0, 1.0], 0.1)), jnp.asarray(found.q_burn)
        )
    )
    halfway = found.ignition + 7.0
    after = inhibit(flight, found, tumbling, halfway)
    assert (float(after.ignition), float(after.cutoff)) == (float(found.ignition), float(halfway))
    # No thrust later either, though the attitude is right again.
    later = inhibit(flight, after, found.q_burn, halfway + 1.0)
    jax.tree.map(np.testing.assert_array_equal, later, after)


def test_thrust_is_not_inhibited_before_and_after_a_burn(flight: FlightParams, known: OrbitEstimate) -> None:
    found = plan(push_back, flight, known)
    elsewhere = np.asarray(look_attitude(flight.vehicle, known)[0])
    assert attitude_difference(elsewhere, found.q_burn) > 1.0
    for time in (found.ignition - 1.0, found.cutoff):
        after = inhibit(flight, found, elsewhere, time)
        jax.tree.map(np.testing.assert_array_equal, after, found)
