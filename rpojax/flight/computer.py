"""Flight computer: tuning, memory, and the stages of flight software in the order in which they run."""

from dataclasses import field

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.fusion_barrier import fusion_barrier
from rpojax.core.orbits.keplerian_elements import mean_motion, semi_major_axis
from rpojax.core.pytree import pytree, replace, select
from rpojax.core.vectors import apply, apply_transposed
from rpojax.flight import navigation_health
from rpojax.flight.control import formation_law, reference_governor, station_keeping, wheel_torque_allocation
from rpojax.flight.control.attitude_control import AttitudeControlTuning
from rpojax.flight.control.formation_tuning import FormationTuning
from rpojax.flight.control.lqr_gain import lqr_gain
from rpojax.flight.control.station_keeping import StationKeeping
from rpojax.flight.guidance import (
    approach_inhibition,
    attitude_guidance,
    burn_planning,
    detector_window,
    line_of_sight_uncertainty,
    slew_profile,
    target_pointing,
    target_visibility,
)
from rpojax.flight.guidance.attitude_guidance import PointingState
from rpojax.flight.guidance.burn_planning import BurnPlan
from rpojax.flight.guidance.detector_window import CameraCommand, CameraFormat
from rpojax.flight.guidance.pointing_tuning import PointingTuning
from rpojax.flight.guidance.target_pointing import TargetPointing
from rpojax.flight.navigation import (
    attitude_ekf,
    detection_model,
    outlier_gate,
    relative_orbit_ekf,
    thrust_estimator,
)
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate, AttitudeFilterTuning
from rpojax.flight.navigation.combined_orbit_filter import Innovation, OrbitEstimate
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, GpsMeasurement
from rpojax.flight.navigation.outlier_gate import GateState
from rpojax.flight.navigation.thrust_estimator import ThrustEstimate
from rpojax.flight.navigation_health import HealthTuning, NavigationHealth
from rpojax.flight.stages import Stages
from rpojax.flight.vehicle_model import VehicleModel

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@pytree
class FlightParams:
    """Tuning of all flight software, and its vehicle model."""

    vehicle: VehicleModel
    navigation: OrbitFilterTuning
    attitude_filter: AttitudeFilterTuning
    formation: FormationTuning
    pointing: PointingTuning
    attitude_control: AttitudeControlTuning
    health: HealthTuning


@pytree
class FlightMemory:
    """State of the flight software.

    Attributes:
        orbit: estimate of both orbits
        gate: state of the outlier gate
        health: tests of the orbit filter, and confidence in it
        attitude: estimate of the attitude
        attitude_variance: () of the camera across its boresight at the last frame [rad^2]
        plan: latest decided burn
        thrust_estimate: estimated thrust
        thruster_failed_at: () when a burn last gave no thrust [s], minus infinity before
        pointing: state of the attitude guidance
        camera: latest command for an exposure
        gain: (3, 6) of the formation controller, solved once at start
        station_keeping: free motion and impulse that keep the station, solved once at start
        wheel_allocation: (3, 3) body torque to wheel torques, solved once at start
    """

    orbit: OrbitEstimate
    gate: GateState
    health: NavigationHealth
    attitude: AttitudeEstimate
    attitude_variance: Array
    plan: BurnPlan
    thrust_estimate: ThrustEstimate
    thruster_failed_at: Array
    pointing: PointingState
    camera: CameraCommand
    gain: Array
    station_keeping: StationKeeping
    wheel_allocation: Array


@pytree
class Measurements:
    """Measurements of one camera tick.

    Attributes:
        gps: position
        star_tracker_q_BN: (4,)
        star_tracker_present: () bool
        box: bounding box
        additional: measurements of additional sensors by name
    """

    gps: GpsMeasurement
    star_tracker_q_BN: Array
    star_tracker_present: Array
    box: BoxMeasurement
    additional: dict[str, Array] = field(default_factory=dict)


def initial(
    params: FlightParams,
    camera: CameraFormat,
    period: float,
    orbit: OrbitEstimate,
    star_tracker_q_BN: Array,
    gyro_B: Vector,
) -> FlightMemory:
    """Memory at the start of a run, from the hand-over's orbit estimate and the first attitude samples.

    `period` [s] is the time between burns.
    """
    r_TN_N = orbit.servicer.r_SN_N + orbit.relative.r_TS_N
    v_TN_N = orbit.servicer.v_SN_N + orbit.relative.v_TS_N
    n = mean_motion(semi_major_axis(r_TN_N, v_TN_N))
    attitude = attitude_ekf.initial(params.attitude_filter, star_tracker_q_BN, gyro_B)
    return FlightMemory(
        orbit=orbit,
        gate=outlier_gate.initial(),
        health=navigation_health.initial(),
        attitude=attitude,
        attitude_variance=_attitude_variance(params.vehicle, attitude),
        plan=burn_planning.no_burn(),
        thrust_estimate=thrust_estimator.initial(),
        thruster_failed_at=jnp.full_like(n, -jnp.inf),
        pointing=attitude_guidance.initial_pointing(params.vehicle, orbit),
        camera=detector_window.whole_frame(camera),
        gain=lqr_gain(params.formation, n, period),
        station_keeping=station_keeping.solve_station_keeping(params.formation, n, period),
        wheel_allocation=wheel_torque_allocation.allocation_matrix(params.vehicle.wheel_axes),
    )


def navigate(
    stages: Stages,
    params: FlightParams,
    gated: bool,
    memory: FlightMemory,
    measurements: Measurements,
    sun_N: Vector,
    time: Scalar,
) -> tuple[FlightMemory, Innovation]:
    """Memory after the updates of attitude and orbit filter at `time` [s], and the orbit filter's diagnostics.

    Boxes are ignored while the target should be dark, with the Sun at `sun_N` [m].
    """
    visible = target_visibility.is_visible(params.vehicle, memory.orbit, sun_N, target_visibility.VISIBILITY_TOLERANCE)
    box = measurements.box
    attitude = stages.call(
        "attitude_update",
        tuning=params.attitude_filter,
        estimate=memory.attitude,
        star_tracker_q_BN=measurements.star_tracker_q_BN,
        present=measurements.star_tracker_present,
        orbit=memory.orbit,
        time=time,
    )
    variance = _attitude_variance(params.vehicle, attitude)
    q_KB = quaternion.normalize(params.vehicle.camera_mounting)
    orbit, gate, innovation = stages.call(
        "orbit_update",
        tuning=params.navigation,
        gated=gated,
        focal_px=params.vehicle.focal_px,
        estimate=memory.orbit,
        gate=memory.gate,
        gps=measurements.gps,
        q_KN=quaternion.multiply(q_KB, attitude.q_BN),
        box=replace(
            box,
            present=box.present & visible,
            expected=box.expected & target_visibility.is_visible(params.vehicle, memory.orbit, sun_N),
            # Absolute: when the star tracker returns, the bearing bias learnt under drift is as wrong.
            attitude_variance_change=jnp.abs(variance - memory.attitude_variance),
        ),
        additional=measurements.additional,
        time=time,
    )
    health = navigation_health.update(
        params.health,
        params.navigation,
        memory.health,
        innovation,
        gate,
        orbit.relative,
        memory.pointing.unseen_time,
        line_of_sight_uncertainty.relative_range_sigma(orbit),
        box.interval,
    )
    after = replace(memory, attitude=attitude, attitude_variance=variance, orbit=orbit, gate=gate, health=health)
    return after, innovation


def _attitude_variance(vehicle: VehicleModel, estimate: AttitudeEstimate) -> Scalar:
    """Variance of the camera's attitude [rad^2], mean of the two axes across its boresight."""
    q_BK = quaternion.conjugate(quaternion.normalize(vehicle.camera_mounting))
    boresight = quaternion.rotate(q_BK, jnp.array([0.0, 0.0, 1.0], dtype=q_BK.dtype))
    P = estimate.covariance[:3, :3]
    return 0.5 * (P[0, 0] + P[1, 1] + P[2, 2] - jnp.sum(boresight * apply(P, boresight), axis=0))


def plan_burn(
    stages: Stages,
    params: FlightParams,
    memory: FlightMemory,
    pointing: TargetPointing,
    time: Scalar,
    period: float,
    dt: float,
) -> FlightMemory:
    """Memory with a new burn plan; no burn while the target is lost or dark, or soon after the thruster failed.

    Burns are `period` [s] apart, and guidance works every `dt` [s].
    """
    missing = memory.pointing.unseen_time > params.health.unseen_limit
    lost = jnp.where(
        _may_be_too_small(params, memory),
        missing | ~memory.pointing.acquired,
        attitude_guidance.is_lost(params.pointing, memory.pointing),
    )
    thruster_works = time >= memory.thruster_failed_at + params.formation.thruster_retry
    command_H, R_CN = formation_command(stages, params, memory, time, dt)
    safe_H = _safe_delta_v(params, memory, pointing, memory.station_keeping.impulse + command_H, period, dt)
    plan = burn_planning.schedule_burn(
        params.formation,
        params.pointing,
        params.vehicle,
        apply_transposed(R_CN, safe_H),
        memory.orbit,
        pointing.q_BN,
        pointing.visible & thruster_works & ~lost,
        time,
        dt,
    )
    return replace(memory, plan=plan)


def _may_be_too_small(params: FlightParams, memory: FlightMemory) -> Bool[Array, ""]:
    """True if the target appears so small that frames without a box are no sign of its loss."""
    relative = memory.orbit.relative
    return detection_model.may_be_too_small(
        params.navigation, params.vehicle.focal_px, relative.r_TS_N, relative.scale[0]
    )


def _safe_delta_v(
    params: FlightParams, memory: FlightMemory, pointing: TargetPointing, wanted_H: Vector, period: float, dt: float
) -> Vector:
    """Velocity change [m/s] of the next burn: that of the law, a stop before darkness, or one that comes less near."""
    formation, orbit = params.formation, memory.orbit
    deviation, _ = burn_planning.deviation_at_burn(formation, memory.station_keeping, orbit)
    station = jnp.concatenate([formation.desired_position, memory.station_keeping.arrival_velocity])
    r_TN_N, v_TN_N = orbit.servicer.r_SN_N + orbit.relative.r_TS_N, orbit.servicer.v_SN_N + orbit.relative.v_TS_N
    n = mean_motion(semi_major_axis(r_TN_N, v_TN_N))
    stays_visible = target_visibility.is_visible_after(
        params.vehicle, orbit, pointing.sun_N, n * (formation.lead + _BURNS_BEFORE_DARKNESS * period)
    )
    return approach_inhibition.inhibit(
        params.health.clearance,
        formation.desired_position,
        deviation + station,
        line_of_sight_uncertainty.relative_range_sigma(orbit) * gradient_safe.norm(orbit.relative.r_TS_N),
        wanted_H,
        burn_planning.certain_delta_v(params.pointing, params.vehicle, dt),
        memory.health.confident,
        stays_visible,
        n,
        period,
    )


def formation_command(
    stages: Stages, params: FlightParams, memory: FlightMemory, time: Scalar, dt: float
) -> tuple[Vector, Float[Array, "3 3"]]:
    """Velocity change [m/s] by the control law in the Hill frame C at the next burn's middle, and `R_CN`.

    The law gets as much of the along-track deviation as the thruster can follow. Guidance works every `dt` [s].
    """
    deviation, R_CN = burn_planning.deviation_at_burn(params.formation, memory.station_keeping, memory.orbit)
    impulse = memory.station_keeping.impulse
    wanted_N = apply_transposed(R_CN, impulse + formation_law.lqr_feedback(memory.gain, deviation))
    q_look, _ = target_pointing.look_attitude(params.vehicle, memory.orbit)
    limit = burn_planning.largest_delta_v(params.pointing, params.vehicle, wanted_N, q_look, dt)
    governed = reference_governor.govern(memory.gain, deviation, impulse, limit)
    command_H = stages.call("formation_law", gain=memory.gain, deviation=governed, estimate=memory.orbit, time=time)
    return command_H, R_CN


def guide(
    params: FlightParams,
    memory: FlightMemory,
    box_accepted: Bool[Array, ""],
    sun_N: Vector,
    time: Scalar,
    dt: float,
) -> tuple[FlightMemory, Array]:
    """Memory with the attitude reference for the next `dt` [s], and the pointing mode; the Sun is at `sun_N` [m]."""
    plan = burn_planning.inhibit(params.pointing, memory.plan, memory.attitude.q_BN, time, dt)
    visible = target_visibility.is_visible(params.vehicle, memory.orbit, sun_N)
    pointing, mode = attitude_guidance.guide(
        params.pointing, params.vehicle, memory.orbit, plan, memory.pointing, box_accepted, visible, time, dt
    )
    not_found = pointing.search_failed & ~_may_be_too_small(params, memory)
    orbit = replace(memory.orbit, relative=relative_orbit_ekf.widen(memory.orbit.relative, not_found))
    return replace(memory, plan=plan, pointing=pointing, orbit=orbit), mode


def control_attitude(
    stages: Stages, params: FlightParams, memory: FlightMemory, wheel_speed: Vector, age: Scalar, time: Scalar
) -> Vector:
    """Wheel torque commands [N m] at `time` [s], `age` [s] after the last guidance tick."""
    return stages.call(
        "wheel_torque",
        control=params.attitude_control,
        vehicle=params.vehicle,
        allocation=memory.wheel_allocation,
        estimate=memory.attitude,
        command=fusion_barrier(slew_profile.evaluate(memory.pointing.reference, age), age),
        wheel_speed=wheel_speed,
        orbit=memory.orbit,
        time=time,
    )


def expected_delta_v(
    params: FlightParams, memory: FlightMemory, ignition: Scalar, cutoff: Scalar, dt: float | Scalar
) -> Vector:
    """Velocity change in N [m/s] that flight software expects over the next `dt` [s].

    The valve is commanded open from `ignition` to `cutoff`, both in [s] from now.
    """
    on = jnp.clip(dt, ignition, cutoff) - jnp.clip(0.0, ignition, cutoff)
    # The derivative of a tie is split between two steps; that of an empty burn must not count.
    on = jnp.where(cutoff > ignition, on, 0.0)
    direction_N = quaternion.rotate(quaternion.conjugate(memory.attitude.q_BN), params.vehicle.thrust_direction)
    return on * params.vehicle.thrust / params.vehicle.mass * direction_N


def predict(
    stages: Stages,
    params: FlightParams,
    zonal_degree: int,
    memory: FlightMemory,
    q_BN_before: Float[Array, "4"],
    delta_v_N: Vector,
    thrust_ratio: Scalar,
    third_body_acceleration_N: Vector,
    end: Scalar,
    dt: float,
) -> FlightMemory:
    """Memory with both filters propagated over the `dt` [s] up to `end` [s] with the expected change `delta_v_N` [m/s].

    `thrust_ratio` is the chamber pressure over its nominal value while the valve was open. A burn without thrust marks
    the thruster as failed.
    """
    burning = jnp.sum(delta_v_N * delta_v_N, axis=0) > 0.0
    thrust_estimate = select(
        burning, thrust_estimator.update(memory.thrust_estimate, thrust_ratio, dt), memory.thrust_estimate
    )
    return replace(
        memory,
        thrust_estimate=thrust_estimate,
        thruster_failed_at=jnp.where(
            burning & (thrust_estimate.ratio < _FAILED_THRUST_RATIO), end, memory.thruster_failed_at
        ),
        orbit=stages.call(
            "orbit_predict",
            tuning=params.navigation,
            zonal_degree=zonal_degree,
            estimate=memory.orbit,
            delta_v_N=thrust_estimate.ratio * delta_v_N,
            burn_delta_v=thrust_estimate.ratio * gradient_safe.norm(memory.plan.delta_v_N),
            burn_sigma_inflation=thrust_estimator.sigma_inflation(thrust_estimate),
            third_body_acceleration_N=third_body_acceleration_N,
            time=end - dt,
            dt=dt,
        ),
        attitude=attitude_ekf.predict_covariance(params.attitude_filter, memory.attitude, q_BN_before, dt),
    )


def command_camera(
    stages: Stages, params: FlightParams, camera: CameraFormat, memory: FlightMemory, time: Scalar
) -> FlightMemory:
    """Memory with the command for an exposure at `time` [s], to which the estimates have been propagated."""
    command = stages.call(
        "detector_window",
        camera=camera,
        vehicle=params.vehicle,
        target_size=params.navigation.target_size,
        orbit=memory.orbit,
        attitude=memory.attitude,
        pointing=memory.pointing,
        time=time,
    )
    return replace(memory, camera=command)


_BURNS_BEFORE_DARKNESS = 3.0
"""Burns before the target is out of sight that stop the relative motion: a single one may be too weak [-]."""


_FAILED_THRUST_RATIO = 0.3
"""Ratio of thrust to its nominal value below which the thruster counts as failed."""


__all__ = [
    "FlightMemory",
    "FlightParams",
    "Measurements",
    "command_camera",
    "control_attitude",
    "expected_delta_v",
    "formation_command",
    "guide",
    "initial",
    "navigate",
    "plan_burn",
    "predict",
]
