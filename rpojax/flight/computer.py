"""The flight computer: tuning, memory, and the stages of flight software in the order in which they run."""

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.frames import apply
from rpojax.core.numerics import safe
from rpojax.core.numerics.fusion_barrier import fusion_barrier
from rpojax.core.orbits.orbital_mechanics import mean_motion, semi_major_axis
from rpojax.core.pytree import pytree, replace, select
from rpojax.flight.control import attitude_control, formation_lqr
from rpojax.flight.control.attitude_control import AttitudeControlTuning
from rpojax.flight.control.formation_lqr import FormationLaw, FormationTuning, StationKeeping
from rpojax.flight.guidance import attitude_guidance, burn_planning, slew_profile, target_pointing
from rpojax.flight.guidance.attitude_guidance import PointingState
from rpojax.flight.guidance.burn_planning import BurnPlan
from rpojax.flight.guidance.pointing_modes import PointingTuning
from rpojax.flight.guidance.target_pointing import TargetPointing
from rpojax.flight.navigation import attitude_ekf, orbit_filter, outlier_gate, thrust_estimator
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate, AttitudeFilterTuning
from rpojax.flight.navigation.filter_tuning import BoxMeasurement, GpsMeasurement, OrbitFilterTuning
from rpojax.flight.navigation.orbit_filter import Innovation, OrbitEstimate
from rpojax.flight.navigation.outlier_gate import GateState
from rpojax.flight.navigation.thrust_estimator import ThrustEstimate
from rpojax.flight.vehicle_model import VehicleModel

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


@pytree
class FlightParams:
    """Everything that is tuned on board, and the vehicle data base."""

    vehicle: VehicleModel
    navigation: OrbitFilterTuning
    attitude_filter: AttitudeFilterTuning
    formation: FormationTuning
    pointing: PointingTuning
    attitude_control: AttitudeControlTuning


@pytree
class FlightMemory:
    """State of the flight software.

    Attributes:
        orbit: estimate of both orbits
        track: memory of the gate
        attitude: estimate of the attitude
        attitude_variance: () of the camera across its boresight at the last frame [rad^2]
        plan: the burn decided last
        thrust: how hard the thruster pushes
        thruster_failed_at: () when a burn last gave no thrust [s], minus infinity before
        pointing: memory of the attitude guidance
        gain: (3, 6) of the formation controller, solved once at start
        station: free motion and impulse that keep the station, solved once at start
        allocation: (3, 3) body torque to wheel torques, solved once at start
    """

    orbit: OrbitEstimate
    gate: GateState
    attitude: AttitudeEstimate
    attitude_variance: Array
    plan: BurnPlan
    thrust_estimate: ThrustEstimate
    thruster_failed_at: Array
    pointing: PointingState
    gain: Array
    station_keeping: StationKeeping
    wheel_allocation: Array


@pytree
class Measurements:
    """What the sensors give at one camera tick.

    Attributes:
        gps: position
        star_tracker_q_BN: (4,)
        star_tracker_present: () bool
        box: bounding box
    """

    gps: GpsMeasurement
    star_tracker_q_BN: Array
    star_tracker_present: Array
    box: BoxMeasurement


OrbitUpdate = Callable[
    [OrbitFilterTuning, bool, Array, OrbitEstimate, GateState, GpsMeasurement, Array, BoxMeasurement],
    tuple[OrbitEstimate, GateState, Innovation],
]
OrbitPrediction = Callable[[OrbitFilterTuning, int, OrbitEstimate, Array, Array, Array, Array, float], OrbitEstimate]
WheelControl = Callable[
    [AttitudeControlTuning, VehicleModel, Array, AttitudeEstimate, attitude_control.AttitudeCommand, Array], Array
]


@dataclass(frozen=True)
class Stages:
    """The replaceable parts of the flight software; pass functions of the same signature to put in your own.

    Attributes:
        orbit_update: filter update with GPS and box, as `orbit_filter.update`
        orbit_predict: filter propagation, as `orbit_filter.predict`
        formation_law: velocity change from the predicted deviation, as `formation_control.lqr`
        wheel_torque: attitude control, as `attitude_control.wheel_torque`
    """

    orbit_update: OrbitUpdate = orbit_filter.update
    orbit_predict: OrbitPrediction = orbit_filter.predict
    formation_law: FormationLaw = formation_lqr.lqr_feedback
    wheel_torque: WheelControl = attitude_control.wheel_torque


def initial(
    params: FlightParams, period: float, orbit: OrbitEstimate, star_tracker_q_BN: Array, gyro_B: Vector
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
        attitude=attitude,
        attitude_variance=_attitude_variance(params.vehicle, attitude),
        plan=burn_planning.no_burn(),
        thrust_estimate=thrust_estimator.initial(),
        thruster_failed_at=jnp.full((), -jnp.inf, dtype=jnp.float64),
        pointing=attitude_guidance.initial_pointing(params.vehicle, orbit),
        gain=formation_lqr.lqr_gain(params.formation, n, period),
        station_keeping=formation_lqr.solve_station_keeping(params.formation, n, period),
        wheel_allocation=jnp.linalg.inv(params.vehicle.wheel_axes.T),
    )


def navigate(
    stages: Stages, params: FlightParams, gated: bool, memory: FlightMemory, measurements: Measurements, sun_N: Vector
) -> tuple[FlightMemory, Innovation]:
    """Memory after the attitude and orbit filters have taken in one tick's measurements; the Sun is at `sun_N` [m].

    A box of a target that lies in the dark is not one.
    """
    visible = target_pointing.is_visible(params.vehicle, memory.orbit, sun_N, target_pointing.VISIBILITY_TOLERANCE)
    box = measurements.box
    attitude = attitude_ekf.update(
        params.attitude_filter,
        memory.attitude,
        measurements.star_tracker_q_BN,
        measurements.star_tracker_present,
    )
    variance = _attitude_variance(params.vehicle, attitude)
    q_KB = quaternion.normalize(params.vehicle.camera_mounting)
    orbit, gate, innovation = stages.orbit_update(
        params.navigation,
        gated,
        params.vehicle.focal_px,
        memory.orbit,
        memory.gate,
        measurements.gps,
        quaternion.multiply(q_KB, attitude.q_BN),
        replace(
            box,
            present=box.present & visible,
            # It goes back as well as it came: once the stars are seen again the learnt drift is wrong.
            attitude_variance_change=jnp.abs(variance - memory.attitude_variance),
        ),
    )
    after = replace(memory, attitude=attitude, attitude_variance=variance, orbit=orbit, gate=gate)
    return after, innovation


def _attitude_variance(vehicle: VehicleModel, estimate: AttitudeEstimate) -> Scalar:
    """Variance of the camera's attitude [rad^2], mean of the two axes across its boresight."""
    q_BK = quaternion.conjugate(quaternion.normalize(vehicle.camera_mounting))
    boresight = quaternion.rotate(q_BK, jnp.array([0.0, 0.0, 1.0], dtype=jnp.float64))
    P = estimate.covariance[:3, :3]
    return 0.5 * (P[0, 0] + P[1, 1] + P[2, 2] - jnp.sum(boresight * apply(P, boresight), axis=0))


def plan_burn(
    stages: Stages, params: FlightParams, memory: FlightMemory, pointing: TargetPointing, time: Scalar
) -> FlightMemory:
    """Memory with a newly decided burn: none while the target is lost or dark, or the thruster has just failed."""
    lost = attitude_guidance.is_lost(params.pointing, memory.pointing)
    works = time >= memory.thruster_failed_at + params.formation.thruster_retry
    plan = burn_planning.plan_burn(
        stages.formation_law,
        params.formation,
        params.pointing,
        params.vehicle,
        memory.gain,
        memory.station_keeping,
        memory.orbit,
        pointing.q_BN,
        pointing.visible & works & ~lost,
        time,
    )
    return replace(memory, plan=plan)


def guide(
    params: FlightParams,
    memory: FlightMemory,
    box_accepted: Bool[Array, ""],
    sun_N: Vector,
    time: Scalar,
    dt: float,
) -> tuple[FlightMemory, Array]:
    """Memory with the attitude reference for the next `dt` [s], and the mode; the Sun is at `sun_N` [m]."""
    plan = burn_planning.inhibit(params.pointing, memory.plan, memory.attitude.q_BN, time, dt)
    visible = target_pointing.is_visible(params.vehicle, memory.orbit, sun_N)
    pointing, mode = attitude_guidance.guide(
        params.pointing, params.vehicle, memory.orbit, plan, memory.pointing, box_accepted, visible, time, dt
    )
    return replace(memory, plan=plan, pointing=pointing), mode


def control_attitude(
    stages: Stages, params: FlightParams, memory: FlightMemory, wheel_speed: Vector, age: Scalar
) -> Vector:
    """Wheel torque commands [N m] `age` [s] after the last guidance tick."""
    command = fusion_barrier(slew_profile.evaluate(memory.pointing.reference, age), age)
    return stages.wheel_torque(
        params.attitude_control, params.vehicle, memory.wheel_allocation, memory.attitude, command, wheel_speed
    )


def expected_delta_v(
    params: FlightParams, memory: FlightMemory, ignition: Scalar, cutoff: Scalar, dt: float | Scalar
) -> Vector:
    """Velocity change in N [m/s] that flight software expects over the next `dt` [s].

    The valve is to be open from `ignition` to `cutoff`, both in [s] from now.
    """
    on = jnp.clip(dt, ignition, cutoff) - jnp.clip(0.0, ignition, cutoff)
    # A tie is split between two steps. That of an empty burn must not count: the step before the decision has no part.
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
    """Memory with both filters carried over the `dt` [s] up to `end` [s] in which the thruster was to give `delta_v_N`.

    `thrust_ratio` is the chamber pressure over its nominal value while the valve was open. A burn without thrust marks
    the thruster as failed.
    """
    burning = jnp.sum(delta_v_N * delta_v_N, axis=0) > 0.0
    thrust_estimate = select(
        burning, thrust_estimator.update(memory.thrust_estimate, thrust_ratio), memory.thrust_estimate
    )
    return replace(
        memory,
        thrust_estimate=thrust_estimate,
        thruster_failed_at=jnp.where(
            burning & (thrust_estimate.ratio < _FAILED_THRUST_RATIO), end, memory.thruster_failed_at
        ),
        orbit=stages.orbit_predict(
            params.navigation,
            zonal_degree,
            memory.orbit,
            thrust_estimate.ratio * delta_v_N,
            thrust_estimate.ratio * safe.norm(memory.plan.delta_v_N),
            thrust_estimator.sigma_inflation(thrust_estimate),
            third_body_acceleration_N,
            dt,
        ),
        attitude=attitude_ekf.predict_covariance(params.attitude_filter, memory.attitude, q_BN_before, dt),
    )


_FAILED_THRUST_RATIO = 0.3
"""Below this ratio of thrust to its nominal value the thruster counts as failed."""


__all__ = [
    "FlightMemory",
    "FlightParams",
    "Measurements",
    "Stages",
    "control_attitude",
    "expected_delta_v",
    "guide",
    "initial",
    "navigate",
    "plan_burn",
    "predict",
]
