"""Channels of a tick: named quantities for recording, with their unit in the name."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion, vectors
from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.mahalanobis_distance import squared_mahalanobis_and_log_determinant
from rpojax.core.numerics import gradient_safe, trigonometric_series
from rpojax.core.quaternion import rotate
from rpojax.core.vectors import apply
from rpojax.errors import RpojaxError
from rpojax.flight.computer import LANDMARKS
from rpojax.flight.control import thruster_isolation
from rpojax.flight.guidance import lens_choice, target_frame
from rpojax.flight.mission import team_mission_state
from rpojax.flight.mission.mission_manager import unmet_conditions
from rpojax.flight.mission.mission_state import MissionState
from rpojax.flight.mission.phase_table import of_phase
from rpojax.flight.navigation import landmark_measurement, target_attitude_ekf
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement
from rpojax.flight.navigation.target_attitude_ekf import TargetAttitude
from rpojax.physics import hull_distance
from rpojax.physics.plant_state import Truth, propellant_used
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import reaction_control, tick_measurements
from rpojax.simulation.camera_models import boresight_N
from rpojax.simulation.telemetry import Telemetry, orbit_errors, true_target_frame

Channels = dict[str, Array]
"""Channels by name."""
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@dataclass(frozen=True)
class ObservedTick:
    """Scenario, parameters and telemetry of a tick; what several channels need is computed once, when first read."""

    scenario: Scenario
    params: Params
    telemetry: Telemetry

    @cached_property
    def in_use(self) -> Params:
        """Parameters with those of the lens of the frame that flight software has."""
        frame = lens_choice.of_frame(self.telemetry.flight.lens, self.telemetry.measurements.is_wide)
        return self.params.seen_through(frame)

    @property
    def truth(self) -> Truth:
        """State of the plant."""
        return self.telemetry.truth

    @cached_property
    def hill_frame(self) -> tuple[Matrix, Vector]:
        """True Hill frame."""
        return hill_frame(self.truth.r_TN_N, self.truth.v_TN_N)

    @property
    def R_HN(self) -> Matrix:
        """Axes of the true Hill frame."""
        return self.hill_frame[0]

    @cached_property
    def orbit_errors(self) -> tuple[Float[Array, "6"], Float[Array, "6"]]:
        """Errors of the servicer, and of the target relative to it, in N [m, m/s]."""
        return orbit_errors(self.telemetry)

    @property
    def servicer_covariance(self) -> Float[Array, "6 6"]:
        """Covariance of the servicer's position and velocity in N."""
        return self.telemetry.flight.orbit.servicer.motion_covariance

    @property
    def relative_covariance(self) -> Float[Array, "6 6"]:
        """Covariance of the target's position and velocity relative to the servicer in N."""
        return self.telemetry.flight.orbit.relative.motion_covariance

    @cached_property
    def servicer_density(self) -> tuple[Scalar, Scalar]:
        """Squared Mahalanobis norm of the servicer's error, and log determinant of its covariance."""
        return squared_mahalanobis_and_log_determinant(self.servicer_covariance, self.orbit_errors[0])

    @cached_property
    def relative_density(self) -> tuple[Scalar, Scalar]:
        """Squared Mahalanobis norm of the relative error, and log determinant of its covariance."""
        return squared_mahalanobis_and_log_determinant(self.relative_covariance, self.orbit_errors[1])

    @property
    def target_reference(self) -> TargetAttitude:
        """Reference of the attitude of the target, where it is estimated."""
        reference = self.telemetry.flight.orbit.relative.target
        assert reference is not None
        return reference

    @cached_property
    def pose_error(self) -> Float[Array, "6"]:
        """Small turn in T from the estimated to the true attitude of the target [rad], error of its rate [rad/s]."""
        slow = self.telemetry.flight.orbit.relative.slow
        turn = quaternion.multiply(
            self.truth.q_TN, quaternion.conjugate(target_attitude_ekf.attitude(self.target_reference, slow))
        )
        return jnp.concatenate([quaternion.log(turn), self.truth.omega_TN_T - slow["rate"]])

    @property
    def pose_covariance(self) -> Float[Array, "6 6"]:
        """Covariance of that error."""
        relative = self.telemetry.flight.orbit.relative
        numbers = jnp.array([*relative.layout.places("attitude"), *relative.layout.places("rate")])
        return relative.covariance[numbers][:, numbers]

    @cached_property
    def pose_density(self) -> tuple[Scalar, Scalar]:
        """Squared Mahalanobis norm of that error, and log determinant of its covariance."""
        return squared_mahalanobis_and_log_determinant(self.pose_covariance, self.pose_error)

    @property
    def port(self) -> tuple[Vector, Vector]:
        """Place of the docking port from the origin of the target's mesh [m], and unit vector out of it, in T."""
        landmarks = self.params.landmarks
        assert landmarks is not None
        assert landmarks.port_position is not None
        assert landmarks.port_axis is not None
        return landmarks.port_position, landmarks.port_axis

    @cached_property
    def at_port(self) -> tuple[Vector, Vector]:
        """Place of the servicer from the docking port, and its velocity in the target's frame, in P [m, m/s]."""
        position_T, axis = self.port
        rho_H, rho_dot_H = inertial_to_hill(self.truth.r_ST_N, self.truth.v_ST_N, *self.hill_frame)
        frame = true_target_frame(self.params, self.truth)
        state_T = target_frame.from_hill(frame, jnp.concatenate([rho_H, rho_dot_H]))
        R_PT = jnp.stack([*vectors.across_axes(axis), axis])
        return apply(R_PT, state_T[:3] - position_T), apply(R_PT, state_T[3:])

    @cached_property
    def boresight_and_line(self) -> tuple[Vector, Vector]:
        """Unit vectors in N along the boresight and to the target."""
        return boresight_N(self.in_use, self.truth), -gradient_safe.normalize(self.truth.r_ST_N)

    @cached_property
    def measured_box(self) -> BoxMeasurement:
        """Measurement of the box."""
        return tick_measurements.box_measurement(self.scenario, self.in_use, self.telemetry.frame)


ChannelFunctions = dict[str, Callable[[ObservedTick], Any]]
"""Channels by name, as functions of a tick."""


def compute_channels(scenario: Scenario, params: Params, telemetry: Telemetry) -> Channels:
    """Channels of one tick: vectors in the true Hill frame, errors as estimate minus truth, sigmas as 1 sigma.

    Measurements of additional sensors are channels too.
    """
    functions = {**CHANNELS}
    if scenario.camera_model == "rendered":
        functions |= IMAGE_CHANNELS
    if telemetry.flight.lens is not None:
        functions |= LENS_CHANNELS
    if scenario.effects.plume:
        functions |= PLUME_CHANNELS
    if telemetry.flight.orbit.relative.target is not None:
        functions |= LANDMARK_CHANNELS
    if scenario.mission.ends_in_target_frame:
        functions |= PORT_CHANNELS
    if scenario.effects.faults and scenario.isolation:
        functions |= ISOLATION_CHANNELS
    if scenario.mission.is_managed:
        functions |= MISSION_CHANNELS
        if scenario.mission.coordinated:
            functions |= TEAM_CHANNELS
            functions |= PHASING_CHANNELS if scenario.mission.phasing != "fixed" else {}
    with jax.named_scope("observe"):
        tick, of_sensors = ObservedTick(scenario, params, telemetry), sensor_channels(telemetry.flight.rejected_s)
        channels = evaluate(functions, functions, tick)
        additional = {**evaluate(of_sensors, of_sensors, tick), **telemetry.measurements.additional}
        if taken := sorted(set(channels) & set(additional)):
            raise RpojaxError(f"{taken[0]}: found a sensor's measurement, expected a name that no channel has")
        channels |= additional
        return {name: _to_single_precision(value) for name, value in channels.items()}


def sensor_channels(sensors: Iterable[str]) -> ChannelFunctions:
    """Channels of sensors of the orbit filter by name."""
    found: ChannelFunctions = {}
    for name in sensors:
        found |= {f"{name}_innovation_sigmas": _sigmas(name), f"{name}_accepted": _is_accepted(name)}
    return found


def evaluate(functions: ChannelFunctions, names: Iterable[str], tick: ObservedTick) -> Channels:
    """Some quantities of a tick, in the precision of the simulation; no others are computed."""
    return {name: functions[name](tick) for name in names}


def _to_single_precision(value: Array) -> Array:
    """Floating-point values in single precision, which halves the records of a campaign."""
    return value.astype(jnp.float32) if jnp.issubdtype(value.dtype, jnp.floating) else value


def _sigmas(sensor: str) -> Callable[[ObservedTick], Array]:
    """Innovations of a sensor in sigmas, NaN where not used."""
    return lambda tick: tick.telemetry.innovation.sensors[sensor].sigmas


def _is_accepted(sensor: str) -> Callable[[ObservedTick], Array]:
    """Whether the filter used the measurement of a sensor."""
    return lambda tick: tick.telemetry.innovation.sensors[sensor].accepted


def _box_accepted(tick: ObservedTick) -> Array:
    """Whether the filter used the box, or left a true one out because it used landmarks of the same picture."""
    sensors, frame = tick.telemetry.innovation.sensors, tick.telemetry.frame
    accepted = sensors["box"].accepted
    if LANDMARKS in sensors:
        shown = landmark_measurement.shows_pose(tick.telemetry.measurements.additional)
        left_out = frame.box.present & ~frame.outlier & ~sensors["box"].rejected & shown
        accepted |= left_out & sensors[LANDMARKS].accepted
    return accepted


def _hill_sigma(tick: ObservedTick, P_N: Matrix) -> Vector:
    """1-sigma along the Hill axes."""
    PR = jnp.sum(P_N[None, :, :] * tick.R_HN[:, None, :], axis=2)
    return gradient_safe.sqrt(jnp.sum(tick.R_HN * PR, axis=1))


def _box_bearing(tick: ObservedTick) -> Vector:
    """Direction of the measured box in H, by the estimated attitude."""
    tangent = tick.measured_box.tangent
    ray_K = jnp.concatenate([tangent, jnp.ones_like(tangent[:1])])
    q_KB = quaternion.normalize(tick.params.flight.vehicle.camera_mounting)
    q_KN = quaternion.multiply(q_KB, tick.telemetry.flight.attitude.q_BN)
    return apply(tick.R_HN, rotate(quaternion.conjugate(q_KN), gradient_safe.normalize(ray_K)))


def _corner_and_sides(edges: Float[Array, "4"]) -> Float[Array, "4"]:
    return jnp.concatenate([edges[:2], edges[2:] - edges[:2]])


def _expected_box(tick: ObservedTick) -> Vector:
    """Centre and side of the box predicted by the orbit filter, NaN if the target is predicted behind the camera."""
    expected, focal = tick.telemetry.innovation.expected_box, tick.in_use.flight.vehicle.focal_px
    center_px = jnp.array([0.5 * tick.scenario.width_px, 0.5 * tick.scenario.height_px], dtype=focal.dtype)
    center = center_px + focal * expected.values[:2]
    side = focal * jnp.exp(expected.values[2:])
    return jnp.where(expected.in_front, jnp.concatenate([center, side]), jnp.nan)


def _gate(tick: ObservedTick) -> Float[Array, "2"]:
    """Half sides of the gate, NaN if the target is predicted behind the camera."""
    expected, flight = tick.telemetry.innovation.expected_box, tick.in_use.flight
    half_sides = flight.navigation.gate_sigma * flight.vehicle.focal_px * gradient_safe.sqrt(expected.variance[:2])
    return jnp.where(expected.in_front, half_sides, jnp.nan)


def _pointing_error(tick: ObservedTick) -> Scalar:
    """Angle from the boresight to the target [deg]."""
    ahead_N, line_N = tick.boresight_and_line
    off = trigonometric_series.arctan2(
        gradient_safe.norm(vectors.cross(ahead_N, line_N)), jnp.sum(ahead_N * line_N, axis=0)
    )
    return jnp.rad2deg(off)


def _failed_tests(tick: ObservedTick) -> Array:
    """Health tests whose threshold is exceeded, as bits in the order of `health_ratios`."""
    ratios = tick.telemetry.flight.health.ratios
    bits = jnp.array([1 << place for place in range(len(ratios))], dtype=jnp.int16)
    return jnp.sum(jnp.where(ratios >= 1.0, bits, 0), axis=0, dtype=jnp.int16)


def _estimated_attitude(tick: ObservedTick) -> Float[Array, "4"]:
    """Estimated attitude of the target, NaN before it was found."""
    q_TN = target_attitude_ekf.attitude(tick.target_reference, tick.telemetry.flight.orbit.relative.slow)
    return jnp.where(tick.target_reference.certain, q_TN, jnp.nan)


def _estimated_place(tick: ObservedTick) -> Vector:
    """Estimated place of the servicer from the origin of the target's mesh in T [m], NaN before T was found."""
    relative = tick.telemetry.flight.orbit.relative
    return rotate(_estimated_attitude(tick), -relative.r_TS_N) - relative.slow["body_offset"]


def _docking_axis_error(tick: ObservedTick) -> Vector:
    """Small turn in T from the estimated to the true axis of the port [deg], NaN of landmarks without one."""
    landmarks, error = tick.params.landmarks, tick.pose_error[:3]
    if landmarks is None or landmarks.port_axis is None:
        return jnp.full_like(error, jnp.nan)
    return jnp.rad2deg(vectors.cross(error, landmarks.port_axis))


def _port_angle(tick: ObservedTick) -> Scalar:
    """Angle between the boresight and the axis of the port, into it [deg]."""
    ahead_T, axis_T = rotate(tick.truth.q_TN, tick.boresight_and_line[0]), -tick.port[1]
    sine, cosine = gradient_safe.norm(vectors.cross(ahead_T, axis_T)), jnp.sum(ahead_T * axis_T, axis=0)
    return jnp.rad2deg(trigonometric_series.arctan2(sine, cosine))


def _hull_distance(tick: ObservedTick) -> Scalar:
    """Distance of the target's convex hull from a sphere about the servicer [m]."""
    plant = tick.params.plant
    assert plant.hull_faces is not None
    # The hull is about the mesh, which the offset moves with the port.
    place_T = rotate(tick.truth.q_TN, tick.truth.r_ST_N) - tick.params.mesh_offset
    return hull_distance.distance_from_hull(plant.target.true_hull, plant.hull_faces, place_T) - plant.servicer.radius


def _is_wide(tick: ObservedTick) -> Array:
    """Whether the frame that flight software has is of the wide lens."""
    telemetry = tick.telemetry
    lens = lens_choice.of_frame(telemetry.flight.lens, telemetry.measurements.is_wide)
    assert lens is not None
    return lens.is_wide


def _mission(tick: ObservedTick) -> MissionState:
    return tick.telemetry.flight.mission


def _unmet_conditions(tick: ObservedTick) -> Array:
    """Conditions of `until` of the present phase that do not hold; 0 in the built-in phases."""
    settings, tuning, state = tick.scenario.mission, tick.params.flight.mission, _mission(tick)
    row = jnp.minimum(state.phase, settings.hold - 1)
    until = of_phase(row, [tuning.phases[phase.name].until for phase in settings.phases])
    unmet = unmet_conditions(until, state, _time(tick))
    return jnp.where(state.phase < settings.hold, unmet, 0).astype(jnp.int8)


def _time(tick: ObservedTick) -> Scalar:
    """Time of the tick [s]."""
    return tick.scenario.tick_s * tick.telemetry.tick.astype(tick.truth.r_ST_N.dtype)


def _isolated(tick: ObservedTick) -> Bool[Array, " n"]:
    """Which thrusters flight software has shut off."""
    rcs = tick.telemetry.flight.rcs
    assert rcs is not None
    assert rcs.isolation is not None
    return thruster_isolation.is_shut_off(rcs.isolation)


def _isolation_delay(tick: ObservedTick) -> Scalar:
    """Time for which a stuck thruster has been open, until its isolation valve is shut [s]; NaN without one."""
    rcs = tick.telemetry.flight.rcs
    assert rcs is not None
    assert rcs.isolation is not None
    open_time = reaction_control.stuck_open_time(tick.scenario, tick.params.plant, rcs.isolation, _time(tick))
    # A frozen run has no time after its failure.
    return jnp.where(tick.telemetry.running, open_time, jnp.nan)


def _changed_for(tick: ObservedTick) -> Array:
    """Place in the team, from 1 on, of the servicer for which a burn decision of this tick was changed; 0 without."""
    team = _mission(tick).team
    assert team is not None
    is_now = jnp.abs(team.changed_at - _time(tick)) < 0.5 * tick.scenario.tick_s
    return jnp.where(is_now, team.changed_for + 1, 0).astype(jnp.int8)


def _phase_shift(tick: ObservedTick) -> Array:
    """Angle by which the relative orbit is ahead of the plan [deg]."""
    team = _mission(tick).team
    assert team is not None
    return jnp.rad2deg(team_mission_state.angle(team, _time(tick)))


def _known_members(tick: ObservedTick) -> Array:
    """Servicers that were in the team at the latest decision, by what is known on board; 0 before."""
    team = _mission(tick).team
    assert team is not None
    assert team.shift is not None
    return jnp.sum(team.shift.present.astype(jnp.int8), axis=0, dtype=jnp.int8)


_RELATIVE_POSITION: Final[ChannelFunctions] = {
    "rho_H": lambda tick: apply(tick.R_HN, tick.truth.r_ST_N),
    "rho_estimate_H": lambda tick: apply(tick.R_HN, -tick.telemetry.flight.orbit.relative.r_TS_N),
    "range_m": lambda tick: gradient_safe.norm(tick.truth.r_ST_N),
    "r_ST_N": lambda tick: tick.truth.r_ST_N,
    "v_ST_N": lambda tick: tick.truth.v_ST_N,
}
_NAVIGATION: Final[ChannelFunctions] = {
    "relative_error_H": lambda tick: apply(tick.R_HN, tick.orbit_errors[1][:3]),
    "relative_sigma_H": lambda tick: _hill_sigma(tick, tick.relative_covariance[:3, :3]),
    "servicer_error_H": lambda tick: apply(tick.R_HN, tick.orbit_errors[0][:3]),
    "servicer_sigma_H": lambda tick: _hill_sigma(tick, tick.servicer_covariance[:3, :3]),
    "target_error_H": lambda tick: apply(tick.R_HN, tick.orbit_errors[0][:3] + tick.orbit_errors[1][:3]),
    "target_sigma_H": lambda tick: _hill_sigma(
        tick, tick.servicer_covariance[:3, :3] + tick.relative_covariance[:3, :3]
    ),
    "nees": lambda tick: tick.servicer_density[0] + tick.relative_density[0],
    "nees_relative": lambda tick: tick.relative_density[0],
    "gps_innovation_sigmas": _sigmas("gps"),
    "box_innovation_sigmas": _sigmas("box"),
    "nav_confident": lambda tick: tick.telemetry.flight.health.confident,
    "health_ratios": lambda tick: tick.telemetry.flight.health.ratios,
    "failed_tests": _failed_tests,
    "star_tracker_present": lambda tick: tick.telemetry.measurements.star_tracker_present,
}
_CAMERA: Final[ChannelFunctions] = {
    "box_present": lambda tick: tick.telemetry.frame.box.present,
    "box_accepted": _box_accepted,
    "box_outlier": lambda tick: tick.telemetry.frame.box.present & tick.telemetry.frame.outlier,
    "box_truncated": lambda tick: tick.telemetry.frame.box.present & tick.telemetry.frame.box.truncated,
    "observable": lambda tick: tick.telemetry.frame.observable,
    "box_bearing_H": _box_bearing,
    "box_range_m": lambda tick: tick.params.flight.navigation.target_size * jnp.exp(-tick.measured_box.log_size),
    "box_px": lambda tick: _corner_and_sides(tick.telemetry.frame.box.edges),
    "box_score": lambda tick: tick.telemetry.frame.score,
    "outline_px": lambda tick: _corner_and_sides(tick.telemetry.frame.outline),
    "expected_px": _expected_box,
    "gate_px": _gate,
}
_VEHICLE: Final[ChannelFunctions] = {
    "mode": lambda tick: tick.telemetry.mode.astype(jnp.int8),
    "running": lambda tick: tick.telemetry.running,
    "pointing_error_deg": _pointing_error,
    "wheel_speed_fraction": lambda tick: tick.truth.wheel_speed / tick.params.plant.wheels.speed_limit,
    "delta_v_m_s": lambda tick: tick.truth.delta_v,
    "mass_kg": lambda tick: tick.truth.mass,
    "propellant_used_kg": lambda tick: propellant_used(tick.params.plant, tick.truth),
}
POSE_CHANNELS: Final[ChannelFunctions] = {
    "r_TN_N": lambda tick: tick.truth.r_TN_N,
    "q_TN": lambda tick: tick.truth.q_TN,
    "q_BN": lambda tick: tick.truth.q_BN,
}
"""Poses of both spacecraft: for playback, for images that are rendered again and for the target's coverage."""
CHANNELS: Final[ChannelFunctions] = {
    **_RELATIVE_POSITION,
    **POSE_CHANNELS,
    **_NAVIGATION,
    **_CAMERA,
    **_VEHICLE,
}
"""Channels by name, as functions of a tick."""
IMAGE_CHANNELS: Final[ChannelFunctions] = {"window_px": lambda tick: tick.telemetry.frame.window}
"""Window of the image of a tick, from which with the poses it can be rendered again."""
LENS_CHANNELS: Final[ChannelFunctions] = {"wide_lens": _is_wide}
"""Lens of a tick, in scenarios with two."""
PLUME_CHANNELS: Final[ChannelFunctions] = {"plume_impulse_n_s": lambda tick: tick.truth.plume_impulse}
"""Load of the thrusters' plumes on the target, in scenarios with it."""
LANDMARK_CHANNELS: Final[ChannelFunctions] = {
    "q_TN_estimate": _estimated_attitude,
    "rho_estimate_T": _estimated_place,
    "target_attitude_error_T_deg": lambda tick: jnp.rad2deg(tick.pose_error[:3]),
    "docking_axis_error_T_deg": _docking_axis_error,
    "target_rate_error_T_deg_s": lambda tick: jnp.rad2deg(tick.pose_error[3:]),
    "target_attitude_sigma_T_deg": lambda tick: jnp.rad2deg(gradient_safe.sqrt(jnp.diagonal(tick.pose_covariance)[:3])),
    "target_attitude_known": lambda tick: tick.target_reference.certain,
    "nees_pose": lambda tick: jnp.where(tick.target_reference.certain, tick.pose_density[0], jnp.nan),
    "landmarks_found": lambda tick: landmark_measurement.count(tick.telemetry.measurements.additional).astype(jnp.int8),
}
"""Attitude of the target, in scenarios whose camera finds landmarks; errors are small turns in T, true by estimate."""
PORT_CHANNELS: Final[ChannelFunctions] = {
    "port_place_P": lambda tick: tick.at_port[0],
    "port_velocity_P": lambda tick: tick.at_port[1],
    "port_angle_deg": _port_angle,
    "hull_distance_m": _hull_distance,
}
"""True place before the docking port, in missions that end there: P has its origin in the port and z along its axis."""
ISOLATION_CHANNELS: Final[ChannelFunctions] = {
    "isolated_thrusters": lambda tick: jnp.sum(_isolated(tick).astype(jnp.int8), axis=0, dtype=jnp.int8),
    "isolation_delay_s": _isolation_delay,
}
"""Thrusters that are shut off, in scenarios whose thrusters may fail and have isolation valves."""
MISSION_CHANNELS: Final[ChannelFunctions] = {
    "rho_desired_H": lambda tick: tick.telemetry.rho_desired_H,
    "phase": lambda tick: _mission(tick).phase.astype(jnp.int8),
    "phase_entered_by": lambda tick: _mission(tick).entered_by.astype(jnp.int8),
    "abort_reason": lambda tick: _mission(tick).abort_reason.astype(jnp.int8),
    "abort_burns": lambda tick: _mission(tick).abort_burns.count.astype(jnp.int8),
    "abort_burn_reason": lambda tick: _mission(tick).abort_burns.reason.astype(jnp.int8),
    "unmet_conditions": _unmet_conditions,
}
"""State of the mission, in scenarios with phases."""
TEAM_CHANNELS: Final[ChannelFunctions] = {"burn_changed_for": _changed_for}
"""Decisions because of other servicers, in coordinated teams."""
PHASING_CHANNELS: Final[ChannelFunctions] = {"phase_shift_deg": _phase_shift, "known_members": _known_members}
"""Phases of relative orbits, in teams that choose them on the way."""
