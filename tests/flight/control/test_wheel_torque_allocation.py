"""Allocation of body torque to the wheels, and the torque limit."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from numpy_reference import IDENTITY, SEEDS, axis_angle_quaternion

from rpojax.core.pytree import replace
from rpojax.flight.control import attitude_control
from rpojax.flight.control.attitude_control import AttitudeCommand
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.flight.vehicle_model import VehicleModel
from rpojax.scenario.params import Params

wheel_torque = jax.jit(attitude_control.wheel_torque)


def estimate(q_BN: jax.Array, omega_BN_B: jax.Array) -> AttitudeEstimate:
    """A perfect estimate."""
    zero = jnp.zeros(3)
    return AttitudeEstimate(
        q_BN=q_BN, omega_BN_B=omega_BN_B, bias_B=zero, gyro_B=omega_BN_B, covariance=jnp.zeros((6, 6))
    )


def at_rest(q_CN: np.ndarray) -> AttitudeCommand:
    return AttitudeCommand(q_CN=q_CN, omega_CN_C=np.zeros(3), acceleration_C=np.zeros(3))


@given(SEEDS)
def test_the_wheels_give_the_body_torque_for_any_axes(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    axes = np.eye(3) + 0.3 * rng.uniform(-1.0, 1.0, (3, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    vehicle: VehicleModel = replace(params.flight.vehicle, wheel_axes=jnp.asarray(axes))
    omega, wanted = 0.01 * rng.normal(size=3), 1e-3 * rng.normal(size=3)
    speed = 50.0 * rng.normal(size=3)
    command = AttitudeCommand(q_CN=IDENTITY, omega_CN_C=omega, acceleration_C=wanted)
    found = np.asarray(
        wheel_torque(
            params.flight.attitude_control, vehicle, np.linalg.inv(axes.T), estimate(IDENTITY, omega), command, speed
        )
    )
    inertia = np.asarray(vehicle.inertia)
    momentum = inertia @ omega + axes.T @ (0.0008 * speed)
    # Without error the torque is feed-forward and gyroscopic compensation.
    np.testing.assert_allclose(-axes.T @ found, inertia @ wanted + np.cross(omega, momentum), atol=1e-15)


def test_the_torque_limit_scales_the_command_and_keeps_its_direction(params: Params) -> None:
    flight = params.flight

    def command(degrees: float) -> np.ndarray:
        body = estimate(axis_angle_quaternion([0.3, -0.5, 0.8], np.deg2rad(degrees)), np.zeros(3))
        allocation = np.eye(3)
        return np.asarray(
            wheel_torque(flight.attitude_control, flight.vehicle, allocation, body, at_rest(IDENTITY), np.zeros(3))
        )

    small, large = command(1.0), command(40.0)
    assert np.max(np.abs(small)) < 0.025
    np.testing.assert_allclose(np.max(np.abs(large)), 0.025, rtol=1e-12)
    np.testing.assert_allclose(large / np.linalg.norm(large), small / np.linalg.norm(small), atol=1e-12)
