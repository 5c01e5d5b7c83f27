"""Attitude control: quaternion signs, and the closed loop with the plant."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from numpy_reference import IDENTITY, SEEDS, attitude_difference, axis_angle_quaternion, random_unit

from rpojax.core import quaternion
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import replace
from rpojax.flight.control import attitude_control
from rpojax.flight.control.attitude_control import AttitudeCommand
from rpojax.flight.guidance import slew_profile
from rpojax.flight.guidance.slew_profile import SlewReference
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.physics import equipment_faults, plant, plant_state
from rpojax.physics.plant_options import Effects
from rpojax.physics.plant_state import Truth
from rpojax.scenario.params import Params

STEP = 0.2
STEPS = 300
wheel_torque = jax.jit(attitude_control.wheel_torque)


def estimate(q_BN: jax.Array, omega_BN_B: jax.Array) -> AttitudeEstimate:
    """A perfect estimate."""
    zero = jnp.zeros(3)
    return AttitudeEstimate(
        q_BN=q_BN, omega_BN_B=omega_BN_B, bias_B=zero, gyro_B=omega_BN_B, covariance=jnp.zeros((6, 6))
    )


def at_rest(q_CN: np.ndarray) -> AttitudeCommand:
    return AttitudeCommand(q_CN=q_CN, omega_CN_C=np.zeros(3), acceleration_C=np.zeros(3))


@jax.jit
def simulate(params: Params, truth: Truth, reference: SlewReference) -> tuple[Truth, AttitudeCommand]:
    """Truth before each step of a minute under the controller, and the commands."""
    flight = params.flight
    allocation = jnp.linalg.inv(flight.vehicle.wheel_axes.T)
    sky = SunMoonPositions(sun_N=jnp.array([1.5e11, 0.0, 0.0]), moon_N=jnp.array([0.0, 3.8e8, 0.0]))

    def body(truth: Truth, t: jax.Array) -> tuple[Truth, tuple[Truth, AttitudeCommand]]:
        command = slew_profile.evaluate(reference, t)
        torque = attitude_control.wheel_torque(
            flight.attitude_control,
            flight.vehicle,
            allocation,
            estimate(truth.q_BN, truth.omega_BN_B),
            command,
            truth.wheel_speed,
        )
        after = plant.step(Effects(), params.plant, truth, torque, (), sky, equipment_faults.healthy(), STEP)
        return after, (truth, command)

    return jax.lax.scan(body, truth, STEP * jnp.arange(STEPS, dtype=jnp.float64))[1]


@pytest.fixture(scope="module")
def start(params: Params) -> Truth:
    truth = plant_state.initial_truth(
        params.plant, params.orbit, jnp.array([0.0, -30.0, 0.0]), jnp.zeros(3), jnp.asarray(IDENTITY)
    )
    return replace(truth, omega_BN_B=jnp.zeros(3), wheel_speed=jnp.array([60.0, -40.0, 80.0]))


def hold(q_EN: np.ndarray) -> SlewReference:
    """A fixed attitude."""
    zero, one = jnp.zeros(()), jnp.ones(())
    return SlewReference(
        q_EN=jnp.asarray(q_EN), omega_EN_E=jnp.zeros(3), remainder=jnp.zeros(3), slew_age=one, slew_time=one + zero
    )


def angles(simulated: tuple[Truth, AttitudeCommand]) -> np.ndarray:
    """Angle between body and command [rad] before each step."""
    truth, command = simulated
    pairs = zip(np.asarray(truth.q_BN), np.asarray(command.q_CN), strict=True)
    return np.array([attitude_difference(body, wanted) for body, wanted in pairs])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_both_signs_of_a_quaternion_give_the_same_torque(params: Params, sign: float) -> None:
    flight = params.flight
    body = estimate(axis_angle_quaternion([1.0, 0.0, 0.0], 0.1), np.zeros(3))
    found = wheel_torque(
        flight.attitude_control, flight.vehicle, np.eye(3), body, at_rest(sign * IDENTITY), np.zeros(3)
    )
    plain = wheel_torque(flight.attitude_control, flight.vehicle, np.eye(3), body, at_rest(IDENTITY), np.zeros(3))
    np.testing.assert_allclose(found, plain, atol=1e-18)
    assert np.max(np.abs(plain)) > 1e-3


@given(SEEDS)
def test_the_response_to_a_small_step_is_a_damped_oscillator_of_the_tuned_bandwidth(
    params: Params, start: Truth, seed: int
) -> None:
    angle = np.deg2rad(0.3)
    simulated = simulate(params, start, hold(axis_angle_quaternion(random_unit(np.random.default_rng(seed)), angle)))
    t = STEP * np.arange(STEPS)
    damped = 0.5 * np.sqrt(1.0 - 0.9**2)
    expected = np.exp(-0.45 * t) * (np.cos(damped * t) + 0.45 / damped * np.sin(damped * t))
    # Holding the torque for a step acts as a delay of half a step: 0.1 s at 0.5 rad/s is 5 per cent.
    np.testing.assert_allclose(angles(simulated) / angle, np.abs(expected), atol=0.05)


def test_a_large_step_saturates_and_still_settles_with_a_small_overshoot(params: Params, start: Truth) -> None:
    axis = np.array([0.0, 0.6, 0.8])
    simulated = simulate(params, start, hold(axis_angle_quaternion(axis, np.deg2rad(100.0))))
    assert angles(simulated)[-1] < np.deg2rad(0.001)
    q_BN = np.asarray(simulated[0].q_BN)
    turned = 2.0 * np.arctan2(q_BN[:, 1:] @ axis, q_BN[:, 0])
    # The damping of 0.9 allows 0.2 per cent; the wheels' limit, which brakes too late, adds the rest.
    assert turned.max() < np.deg2rad(120.0)


def test_a_planned_slew_is_tracked_with_spinning_wheels(params: Params, start: Truth) -> None:
    angle = np.deg2rad(90.0)
    end = axis_angle_quaternion([0.0, 0.6, 0.8], angle)
    time = float(slew_profile.slew_duration(params.flight.pointing, jnp.float64(angle)))
    remainder = quaternion.log(quaternion.conjugate(jnp.asarray(end)))
    reference = replace(hold(end), remainder=remainder, slew_age=jnp.zeros(()), slew_time=jnp.float64(time))
    simulated = simulate(params, start, reference)
    assert time < STEP * STEPS
    # The remaining error is the half step by which the held torque lags the profile.
    assert angles(simulated).max() < np.deg2rad(0.3)
    assert angles(simulated)[-1] < np.deg2rad(0.001)


def test_a_reference_with_constant_rate_is_tracked(params: Params, start: Truth) -> None:
    rate = jnp.array([0.0, 0.0, 0.01])
    turning = replace(start, omega_BN_B=rate)
    simulated = simulate(params, turning, replace(hold(IDENTITY), omega_EN_E=rate))
    assert angles(simulated).max() < np.deg2rad(0.01)
    np.testing.assert_allclose(simulated[0].omega_BN_B[-1], rate, atol=1e-5)
