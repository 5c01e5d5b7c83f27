"""Reaction wheels: torque and speed limits, friction and quantised torque."""

import jax
import numpy as np
import pytest

from rpojax.physics import reaction_wheels
from rpojax.scenario.params import Params

EXACT = 1e-14  # a few roundings of numbers near one
STEP = 0.2
friction = jax.jit(reaction_wheels.bearing_friction)
limited_torque = jax.jit(reaction_wheels.limit_torque, static_argnums=3)
quantised = jax.jit(reaction_wheels.quantise_torque)


def test_a_torque_command_within_the_limits_is_unchanged(params: Params) -> None:
    command = np.array([0.01, -0.02, 0.0])
    np.testing.assert_array_equal(limited_torque(params.plant.wheels, command, np.zeros(3), STEP), command)


def test_torque_commands_are_limited_wheel_by_wheel(params: Params) -> None:
    found = limited_torque(params.plant.wheels, np.array([1.0, -1.0, 0.01]), np.zeros(3), STEP)
    np.testing.assert_array_equal(found, [0.025, -0.025, 0.01])


def test_torque_near_the_speed_limit_reaches_it_exactly(params: Params) -> None:
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


def test_friction_opposes_the_speed_and_is_odd(params: Params) -> None:
    wheels = params.plant.wheels
    speed = np.array([100.0, -100.0, 2.0])
    found = np.asarray(friction(wheels, speed))
    assert np.all(found * speed < 0.0)
    assert found[0] == -found[1]
    np.testing.assert_array_equal(friction(wheels, -speed), -found)


def test_friction_of_a_fast_wheel_is_viscous_plus_full_coulomb_torque(params: Params) -> None:
    found = friction(params.plant.wheels, np.array([100.0, -600.0, 0.0]))
    np.testing.assert_allclose(found, [-2e-4 - 3e-4, 1.2e-3 + 3e-4, 0.0], rtol=EXACT)


def test_friction_is_linear_in_speed_near_zero(params: Params) -> None:
    derivative = jax.jacfwd(lambda speed: friction(params.plant.wheels, speed))(np.zeros(3))
    np.testing.assert_allclose(derivative, -(2e-6 + 3e-4 / 1.0) * np.eye(3), rtol=EXACT)


def test_torque_commands_are_rounded_to_whole_steps(params: Params) -> None:
    step = 2e-5
    found = quantised(params.plant.wheels, np.array([7.4 * step, 7.6 * step, -0.4 * step]))
    np.testing.assert_allclose(found, [7 * step, 8 * step, 0.0], atol=1e-18)


def test_rounding_leaves_the_derivative_unchanged(params: Params) -> None:
    derivative = jax.jacrev(lambda command: quantised(params.plant.wheels, command))(np.array([1.3e-4, 0.0, -0.02]))
    np.testing.assert_array_equal(derivative, np.eye(3))
