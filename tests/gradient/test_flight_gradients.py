"""Derivatives of filters, guidance and control in both modes against finite differences."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from gradient_checks import Q, V, W, check, check_finite
from numpy_reference import IDENTITY, axis_angle_quaternion, random_covariance, rotation_matrix

from rpojax.core import kalman_update, quaternion
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.orbits.yamanaka_ankersen import advanced
from rpojax.core.pytree import replace
from rpojax.flight.control import attitude_control, formation_law
from rpojax.flight.control.attitude_control import AttitudeCommand
from rpojax.flight.control.formation_law import lqr_gain
from rpojax.flight.decisions.motion_prediction import predict_to_burn
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import burn_schedule, slew_profile, target_pointing
from rpojax.flight.guidance.references.impulsive_tracking import tracked_point
from rpojax.flight.guidance.slew_profile import SlewReference
from rpojax.flight.navigation import attitude_ekf, combined_orbit_filter, relative_orbit_ekf, servicer_orbit_ekf
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.flight.navigation.lasting_error_effects import LastingEffects
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, GpsMeasurement, box_view
from rpojax.scenario.params import Params


@jax.jit
def measurement_update(x: jax.Array, covariance: jax.Array, z: jax.Array, H: jax.Array, R: jax.Array) -> Any:
    rows = MeasurementRows(
        residual=z + x[:3],
        jacobian=H + x[3:15].reshape(3, 4),
        variance=R * (1.0 + x[15:18]),
        weight=jnp.array([1.0, 0.0, 1.0]),
    )
    result = kalman_update.update(covariance * (1.0 + x[18]), rows)
    return replace(result, used=jnp.zeros(()))  # decisions have no derivative


def test_derivatives_of_a_measurement_update_are_right() -> None:
    rng = np.random.default_rng(2)
    check(
        measurement_update,
        19,
        random_covariance(rng, np.ones(4)),
        rng.normal(size=3),
        rng.normal(size=(3, 4)),
        rng.uniform(0.5, 2.0, 3),
    )


@jax.jit
def wheel_command(x: jax.Array, flight: FlightParams, q_BC: jax.Array) -> jax.Array:
    q_BN = quaternion.multiply(quaternion.exp(0.1 * x[:3]), q_BC)
    omega = 0.01 * x[3:6]
    body = AttitudeEstimate(
        q_BN=q_BN, omega_BN_B=omega, bias_B=jnp.zeros(3), gyro_B=omega, covariance=jnp.zeros((6, 6))
    )
    command = AttitudeCommand(q_CN=jnp.asarray(IDENTITY), omega_CN_C=0.01 * x[6:], acceleration_C=jnp.zeros(3))
    speed = jnp.array([10.0, -20.0, 30.0])
    return 10.0 * attitude_control.wheel_torque(
        flight.attitude_control, flight.vehicle, jnp.eye(3), body, command, speed
    )


@pytest.mark.parametrize("angle", [0.0, 0.02, 2.0], ids=["no error", "small error", "saturated"])
def test_derivatives_of_the_attitude_controller_are_right(params: Params, angle: float) -> None:
    check(wheel_command, 9, params.flight, axis_angle_quaternion(V, angle))


@jax.jit
def attitude_update(x: jax.Array, flight: FlightParams, q_BN: jax.Array) -> Any:
    tuning = flight.attitude_filter
    before = attitude_ekf.initial(tuning, q_BN, 0.01 * jnp.asarray(V))
    measured = quaternion.multiply(quaternion.exp(1e-3 * x[:3]), q_BN)
    louder = replace(tuning, star_tracker_noise=tuning.star_tracker_noise * (1.0 + x[3:]))
    after = attitude_ekf.update(louder, before, measured, jnp.asarray(True))
    return 1e3 * after.q_BN, 1e3 * after.bias_B, 1e6 * after.covariance


def test_derivatives_of_the_attitude_filters_update_are_right(params: Params) -> None:
    check(attitude_update, 6, params.flight, Q)


@jax.jit
def slew_command(x: jax.Array, q_EN: jax.Array, remainder: jax.Array, age: jax.Array) -> AttitudeCommand:
    reference = SlewReference(
        q_EN=q_EN,
        omega_EN_E=0.01 * x[:3],
        remainder=remainder + x[3:6],
        slew_age=jnp.zeros(()),
        slew_time=20.0 + x[6],
    )
    return slew_profile.evaluate(reference, age)


@pytest.mark.parametrize("size", [0.0, 1.0], ids=["no angle", "a radian"])
@pytest.mark.parametrize("age", [0.0, 4.0, 30.0], ids=["its start", "its middle", "after its end"])
def test_derivatives_of_a_slew_are_right(age: float, size: float) -> None:
    check(slew_command, 7, Q, size * W, np.float64(age))


@jax.jit
def slew_duration(x: jax.Array, flight: FlightParams, angle: jax.Array) -> jax.Array:
    return slew_profile.slew_duration(flight.pointing, angle + x[0])


@pytest.mark.parametrize("angle", [0.0, 1e-12], ids=["zero", "nearly zero"])
def test_the_duration_of_a_slew_over_zero_angle_has_a_finite_derivative(params: Params, angle: float) -> None:
    check_finite(slew_duration, 1, params.flight, np.float64(angle))


@jax.jit
def planned_burn(x: jax.Array, flight: FlightParams, r_TS_N: jax.Array, gain: jax.Array) -> Any:
    known = rendezvous_scene.estimate(flight, r_TS_N + x[:3], 0.01 * jnp.asarray(V) + 0.01 * x[3:6])
    allowed, time = jnp.asarray(True), jnp.asarray(0.0)
    q_BN, omega = target_pointing.look_attitude(flight.vehicle, known)
    predicted, place = predict_to_burn(flight, known), flight.formation.desired_position
    times = jnp.array([-200.0, 0.0, 200.0])
    orbits = jax.vmap(advanced, in_axes=(None, 0))(predicted.burn_orbit, times)
    station = tracked_point(orbits, times[2], jnp.stack([place, place, place]))
    deviation = predicted.burn_state_H - jnp.concatenate([place, station.arrival_velocity])
    command_H = formation_law.lqr_feedback(gain * (1.0 + 0.1 * x[6]), deviation)
    delta_v_N = jnp.sum(predicted.R_CN * (station.impulse + command_H)[:, None], axis=0)
    guidance = rendezvous_scene.software(flight).guidance
    plan = burn_schedule.schedule_burn(guidance, delta_v_N, q_BN, allowed, time)
    return 0.1 * plan.ignition, 0.1 * plan.cutoff, 1e2 * plan.delta_v_N, plan.q_burn, q_BN, 1e2 * omega


def test_derivatives_of_the_burn_plan_and_of_the_look_attitude_are_right(params: Params) -> None:
    gain = lqr_gain(params.flight.formation, jnp.asarray(1.1e-3), 200.0)
    check(planned_burn, 7, params.flight, rendezvous_scene.TARGET_AHEAD + np.array([1.0, -2.0, 3.0]), gain)


PUSHED = LastingEffects(thrust_axes_N=jnp.eye(3), ballistic_N=jnp.array([2e-5, -3e-5, 1e-5]))


@jax.jit
def prediction(x: jax.Array, flight: FlightParams, delta_v_N: jax.Array) -> Any:
    known = rendezvous_scene.estimate(flight)
    relative = replace(known.relative, r_TS_N=known.relative.r_TS_N + 10.0 * x[:3])
    servicer = replace(known.servicer, v_SN_N=known.servicer.v_SN_N + 10.0 * x[3:6])
    tuning = replace(flight.navigation, relative_acceleration_noise=1e-3 * (1.0 + x[6]))
    moved = replace(known, relative=relative, servicer=servicer)
    gained, doubt, pull_N = delta_v_N + 1e-3 * x[7:10], 2.0 + x[10], 1e-6 * x[11:]
    after = combined_orbit_filter.predict(tuning, 6, moved, gained, jnp.asarray(0.02), doubt, pull_N, PUSHED, 1.0)
    sigma = jnp.repeat(jnp.array([0.2, 1e-3, 0.1, 1e-3, 5e-3]), np.array([3, 3, 2, 2, 2]), total_repeat_length=12)
    sigma = jnp.append(sigma, jnp.array([0.015, 0.01, 0.01, 0.005]))
    return (
        after.relative.r_TS_N - known.relative.r_TS_N,
        after.servicer.r_SN_N - known.servicer.r_SN_N,
        after.relative.covariance / (sigma[:, None] * sigma[None, :]),
    )


def test_derivatives_of_the_orbit_filters_prediction_are_right_during_a_burn(params: Params) -> None:
    check(prediction, 14, params.flight, 1e-3 * V)


def test_the_orbit_filters_prediction_has_finite_derivatives_to_a_velocity_change_of_zero(params: Params) -> None:
    check_finite(prediction, 14, params.flight, np.zeros(3))


@jax.jit
def box_update(x: jax.Array, flight: FlightParams, q_KN: jax.Array, box: BoxMeasurement, sigma: jax.Array) -> Any:
    """Update by a box that agrees with the previous one, of a target known to `sigma` [m]."""
    known = rendezvous_scene.estimate(flight).relative
    scale = jnp.eye(known.layout.size).at[:3, :3].multiply(sigma**2 / 0.2**2)
    moved = replace(known, r_TS_N=known.r_TS_N + x[:3], covariance=known.covariance * scale)
    measured = replace(box, tangent=box.tangent + 0.1 * x[3:5], log_size=box.log_size + x[5])
    tuning = replace(flight.navigation, edge_noise=1.0 + x[6], scale_sigma=flight.navigation.scale_sigma + 0.1 * x[7:])
    track = rendezvous_scene.gate_after_a_box()
    after, _, result, _ = relative_orbit_ekf.update(
        tuning, True, moved, track, box_view(measured, flight.vehicle.focal_px, q_KN)
    )
    return after.r_TS_N - known.r_TS_N, after.slow["size"], 1e2 * after.covariance, 1e-3 * result.log_likelihood


@pytest.fixture(scope="module")
def q_KN(params: Params) -> np.ndarray:
    """Attitude of a camera that points at the target."""
    return rendezvous_scene.camera_attitude(params.flight, rendezvous_scene.estimate(params.flight))


@pytest.mark.parametrize("present", [True, False], ids=["with a box", "without a box"])
@pytest.mark.parametrize("sigma", [0.05, 1.0], ids=["narrow prior", "wide prior"])
def test_derivatives_of_a_box_update_are_right_far_from_the_gates_border(
    params: Params, q_KN: np.ndarray, sigma: float, present: bool
) -> None:
    box = rendezvous_scene.box(params.flight, rotation_matrix(q_KN), rendezvous_scene.TARGET_AHEAD, present=present)
    check(box_update, 9, params.flight, q_KN, box, np.float64(sigma))


@pytest.mark.parametrize("offset", [0.01, 0.05], ids=["near the border", "outlier"])
def test_a_box_update_has_finite_derivatives_at_and_beyond_the_gates_border(
    params: Params, q_KN: np.ndarray, offset: float
) -> None:
    box = rendezvous_scene.box(params.flight, rotation_matrix(q_KN), rendezvous_scene.TARGET_AHEAD)
    moved = replace(box, tangent=box.tangent + jnp.array([offset, 0.0]))
    check_finite(box_update, 9, params.flight, q_KN, moved, np.float64(0.05))


@jax.jit
def gps_update(x: jax.Array, flight: FlightParams, gps_N: jax.Array) -> Any:
    tuning = replace(flight.navigation, gps_noise=2.0 + x[3])
    gps = GpsMeasurement(position_N=gps_N + x[:3], present=jnp.asarray(True))
    after, result = servicer_orbit_ekf.update(tuning, rendezvous_scene.estimate(flight).servicer, gps)
    return after.r_SN_N - rendezvous_scene.R_SN_N, after.gps_error_N, result.log_likelihood


def test_derivatives_of_a_gps_update_are_right(params: Params) -> None:
    check(gps_update, 4, params.flight, rendezvous_scene.R_SN_N + 3.0 * V)
