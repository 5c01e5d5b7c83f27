"""Wheel limits, the thruster's force, and its exact cut-off inside a step."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from rpojax.core.pytree import replace
from rpojax.physics import actuators
from rpojax.physics.actuators import BurnError
from rpojax.simulation.params import Params

EXACT = 1e-14  # a few roundings of numbers near one
STEP = 0.2

limited_torque = jax.jit(actuators.limited_torque, static_argnums=3)
force_and_torque = jax.jit(actuators.force_and_torque)
stage_fractions = jax.jit(actuators.stage_fractions, static_argnums=2)
NO_ERROR = BurnError(magnitude=jnp.zeros(()), direction=jnp.zeros(3))


def test_a_torque_command_within_the_limits_is_carried_out(params: Params) -> None:
    command = np.array([0.01, -0.02, 0.0])
    np.testing.assert_array_equal(limited_torque(params.plant.wheels, command, np.zeros(3), STEP), command)


def test_a_torque_command_beyond_the_limit_is_cut_wheel_by_wheel(params: Params) -> None:
    found = limited_torque(params.plant.wheels, np.array([1.0, -1.0, 0.01]), np.zeros(3), STEP)
    np.testing.assert_array_equal(found, [0.025, -0.025, 0.01])


def test_a_wheel_near_its_speed_limit_gets_just_the_torque_that_reaches_it(params: Params) -> None:
    wheels = params.plant.wheels
    speed = np.array([627.0, -627.0, 620.0])
    found = np.asarray(limited_torque(wheels, np.array([0.02, -0.02, 0.02]), speed, STEP))
    reached = speed + found * STEP / np.asarray(wheels.inertia)
    np.testing.assert_allclose(reached[:2], [628.0, -628.0], rtol=EXACT)
    assert found[2] == 0.02


@pytest.mark.parametrize("speed", [628.0, 640.0])
def test_a_wheel_at_or_beyond_its_speed_limit_can_only_slow_down(params: Params, speed: float) -> None:
    speeds = np.array([speed, -speed, speed])
    found = limited_torque(params.plant.wheels, np.array([0.02, -0.02, -0.02]), speeds, STEP)
    np.testing.assert_array_equal(found, [0.0, 0.0, -0.02])


def test_an_aligned_thruster_pushes_along_its_direction_with_its_true_force(params: Params) -> None:
    thruster = replace(params.plant.thruster, direction=jnp.array([0.0, 3.0, 4.0]), force_scale=jnp.float64(1.1))
    force, torque = force_and_torque(thruster, NO_ERROR)
    np.testing.assert_allclose(force, 0.033 * np.array([0.0, 0.6, 0.8]), rtol=EXACT)
    np.testing.assert_allclose(torque, np.cross([-0.25, 0.0, 0.0], force), atol=EXACT)


def test_misalignment_and_burn_error_turn_and_scale_the_force(params: Params) -> None:
    thruster = replace(params.plant.thruster, misalignment=jnp.array([0.0, 0.0, 0.02]))
    error = BurnError(magnitude=jnp.float64(-0.1), direction=jnp.array([0.0, 0.0, 0.03]))
    force, _ = force_and_torque(thruster, error)
    np.testing.assert_allclose(force, 0.027 * np.array([np.cos(0.05), np.sin(0.05), 0.0]), atol=EXACT)


def test_burn_errors_have_the_thrusters_standard_deviations(params: Params) -> None:
    error = actuators.draw_burn_error(params.plant.thruster, jnp.array([1.0, -1.0, 2.0, 0.0]))
    np.testing.assert_allclose(error.magnitude, 0.01)
    np.testing.assert_allclose(error.direction, np.deg2rad([-0.2, 0.4, 0.0]))


def test_the_flow_of_propellant_is_force_over_exhaust_speed(params: Params) -> None:
    flow = actuators.mass_flow(params.plant.thruster, jnp.array([0.0, -0.03, 0.04]))
    np.testing.assert_allclose(flow, 0.05 / (70.0 * 9.80665), rtol=EXACT)


@given(st.floats(-1.0, 1.0), st.floats(0.0, 1.0))
def test_the_thrust_of_a_step_has_the_moments_of_the_true_on_and_off_times(ignition: float, on_time: float) -> None:
    cutoff = ignition + on_time
    weights = np.array([1.0, 4.0, 1.0]) * STEP / 6.0  # Simpson's rule over the three stages
    times = np.array([0.0, STEP / 2, STEP])
    fractions = np.array([float(f) for f in stage_fractions(np.float64(ignition), np.float64(cutoff), STEP)])
    begin, end = np.clip([ignition, cutoff], 0.0, STEP)
    for power in range(3):
        primitive = Polynomial([0.0] * power + [1.0]).integ()
        expected = primitive(end) - primitive(begin)
        np.testing.assert_allclose(weights @ (fractions * times**power), expected, atol=1e-15)


@pytest.mark.parametrize(("ignition", "cutoff"), [(-2.0, -1.0), (STEP, 1.0), (0.3, 0.9), (0.1, 0.1), (0.15, 0.05)])
def test_a_burn_outside_of_the_step_or_without_duration_gives_no_thrust(ignition: float, cutoff: float) -> None:
    fractions = stage_fractions(np.float64(ignition), np.float64(cutoff), STEP)
    np.testing.assert_array_equal(fractions, [0.0, 0.0, 0.0])
