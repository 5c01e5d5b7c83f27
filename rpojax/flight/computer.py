"""Flight computer: the stages of the flight software in the order in which they run; burns: `decisions`."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.fusion_barrier import fusion_barrier
from rpojax.core.pytree import replace
from rpojax.core.vectors import apply
from rpojax.flight import control_effort, navigation_health
from rpojax.flight.control import rcs_control, wheel_torque_allocation
from rpojax.flight.decisions import burn_conditions, mission_decision
from rpojax.flight.decisions.mission_decision import TeamStart
from rpojax.flight.flight_records import FlightMemory, FlightParams, Measurements
from rpojax.flight.flight_software import FlightSoftware
from rpojax.flight.guidance import (
    attitude_guidance,
    burn_schedule,
    detector_window,
    lens_choice,
    line_of_sight_uncertainty,
    slew_profile,
    target_visibility,
)
from rpojax.flight.guidance.attitude_guidance import GuidanceTick
from rpojax.flight.guidance.target_acquisition import Sighting
from rpojax.flight.navigation import (
    attitude_ekf,
    landmark_measurement,
    lasting_adaptation,
    relative_filter_state,
    relative_orbit_ekf,
    retrodiction,
    symmetric_landmarks,
    target_attitude_ekf,
    thrust_estimator,
)
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.flight.navigation.believed_sensor import BelievedSensor, SensorView
from rpojax.flight.navigation.box_measurement import outlier_gate
from rpojax.flight.navigation.combined_orbit_filter import Innovation, OrbitEstimate
from rpojax.flight.navigation.lasting_adaptation import Adaptation
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement
from rpojax.flight.navigation.relative_filter_state import LANDMARK_NETWORK, RelativeEstimate
from rpojax.flight.navigation.retrodiction import Exposure, History
from rpojax.flight.navigation_health import HealthEvidence
from rpojax.flight.vehicle_model import VehicleModel

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]

LANDMARKS: Final = "landmarks"
"""Name of the sensor that shows the attitude of the target."""


def initial(
    software: FlightSoftware,
    orbit: OrbitEstimate,
    star_tracker_q_BN: Array,
    gyro_B: Vector,
    team: TeamStart | None = None,
) -> FlightMemory:
    """Memory at the start of a run, from the hand-over's orbit estimate and the first attitude samples."""
    params, memory_ticks = software.params, software.filter.memory_ticks
    never = jnp.zeros_like(params.vehicle.mass)
    attitude = attitude_ekf.initial(params.attitude_filter, star_tracker_q_BN, gyro_B)
    return FlightMemory(
        orbit=orbit,
        gate=outlier_gate.initial(),
        health=navigation_health.initial(orbit.relative),
        attitude=attitude,
        attitude_variance=_attitude_variance(params.vehicle, attitude),
        plan=burn_schedule.no_burn(),
        thrust_estimate=thrust_estimator.initial(params.navigation),
        thruster_failed_at=never - jnp.inf,
        pointing=attitude_guidance.initial_pointing(params.vehicle, orbit),
        reopened=jnp.zeros((), dtype=bool),
        camera=detector_window.whole_frame(software.camera),
        wheel_allocation=wheel_torque_allocation.allocation_matrix(params.vehicle.wheel_axes),
        mission=mission_decision.initial_state(software, orbit, team),
        phase_gains=mission_decision.phase_gains(software, orbit),
        rejected_s=dict.fromkeys(params.sensors, never),
        own=software.stages.initial_memory(params=params, estimate=orbit, attitude=attitude, camera=software.camera),
        history=retrodiction.no_history(memory_ticks, attitude.q_BN) if memory_ticks else None,
        rcs=None if params.thrusters is None else rcs_control.no_command(params.thrusters, software.isolates),
        lens=None if params.wide_lens is None else lens_choice.first_lens(params.wide_lens, _distance(orbit)),
    )


def _distance(estimate: OrbitEstimate) -> Scalar:
    return gradient_safe.norm(estimate.relative.r_TS_N)


def navigate(
    software: FlightSoftware, memory: FlightMemory, measurements: Measurements, sun_N: Vector, time: Scalar
) -> tuple[FlightMemory, Innovation]:
    """Memory after the updates of attitude and orbit filter at `time` [s], and the orbit filter's diagnostics.

    Boxes are ignored while the target should be dark, with the Sun at `sun_N` [m].
    """
    frame = lens_choice.of_frame(memory.lens, measurements.is_wide)
    params, stages = software.params.seen_through(frame), software.stages
    attitude, own = stages.call_with_memory(
        "attitude_update",
        memory.own,
        tuning=params.attitude_filter,
        estimate=memory.attitude,
        star_tracker_q_BN=measurements.star_tracker_q_BN,
        present=measurements.star_tracker_present,
        orbit=memory.orbit,
        time=time,
    )
    variance = _attitude_variance(params.vehicle, attitude)
    exposures = _exposures(software, memory.history, attitude.q_BN, measurements)
    view_of = _views(params, attitude, exposures, time)
    rows = _believed_rows(params, measurements, view_of)
    box = filtered_box(params, replace(memory, lens=frame), variance, measurements.box, sun_N)
    box = _beside_landmarks(software, memory, measurements, box)
    (orbit, gate, innovation), own = stages.call_with_memory(
        "orbit_update",
        own,
        tuning=params.navigation,
        gated=software.filter.gated,
        focal_px=params.vehicle.focal_px,
        estimate=memory.orbit,
        gate=memory.gate,
        gps=measurements.gps,
        q_KN=camera_attitude(params.vehicle, exposures["camera"].q_BN if "camera" in exposures else attitude.q_BN),
        box=box,
        additional=measurements.additional,
        sensors={each.name: partial(rows, each) for each in software.filter.sensors},
        picture=measurements.picture,
        window=memory.camera if measurements.window is None else measurements.window,
        exposures=exposures,
        time=time,
    )
    orbit, rejected_s = _recovered(params, memory, orbit, innovation, box.interval)
    orbit = _with_target_attitude(software, measurements, view_of, exposures.get(LANDMARKS), orbit, innovation)
    adaptation = lasting_adaptation.adapt(params.navigation, orbit.relative, memory.health.lasting, box)
    orbit = replace(orbit, relative=adaptation.estimate)
    after = replace(
        memory,
        attitude=attitude,
        attitude_variance=variance,
        orbit=orbit,
        gate=gate,
        rejected_s=rejected_s,
        own=own,
        lens=lens_choice.after_frame(memory.lens, frame),
    )
    evidence = _health_evidence(memory, after, innovation, adaptation, box.interval, time)
    health = navigation_health.update(params.health, params.navigation, memory.health, evidence)
    return replace(after, health=health), innovation


def _beside_landmarks(
    software: FlightSoftware, memory: FlightMemory, measurements: Measurements, box: BoxMeasurement
) -> BoxMeasurement:
    """The box, left out where the same picture shows the pose: its errors are those of the landmarks, but larger.

    It is used where landmarks contradict the attitude.
    """
    target = memory.orbit.relative.target
    if target is None or LANDMARKS not in (each.name for each in software.filter.sensors):
        return box
    agrees = target.known & (target.unexplained_s <= 0.0)
    shown = agrees & landmark_measurement.shows_pose(measurements.additional)
    return replace(box.only_where(~shown), expected=box.expected & ~shown)


ViewOf = Callable[[str, RelativeEstimate], SensorView]
"""What is known where a measurement of a sensor, by its name, is used with an estimate at its exposure."""


def _views(params: FlightParams, attitude: AttitudeEstimate, exposures: Mapping[str, Exposure], time: Scalar) -> ViewOf:
    """Views of sensors, whose exposure is at `time` [s] unless they are late."""

    def view(name: str, relative: RelativeEstimate) -> SensorView:
        q_BN, exposed = attitude.q_BN, time
        if name in exposures:
            q_BN, exposed = exposures[name].q_BN, time - exposures[name].age
        return SensorView(
            tuning=params.navigation,
            relative=relative,
            q_BN=q_BN,
            time=exposed,
            vehicle=params.vehicle,
            target=params.target,
        )

    return view


def _believed_rows(
    params: FlightParams, measurements: Measurements, view_of: ViewOf
) -> Callable[[BelievedSensor, RelativeEstimate], MeasurementRows]:
    """Rows of the measurement of a sensor for an estimate at its exposure."""

    def rows(sensor: BelievedSensor, relative: RelativeEstimate) -> MeasurementRows:
        view = view_of(sensor.name, relative)
        return sensor.checked_rows(params.sensors[sensor.name], view, measurements.additional)

    return rows


def _with_target_attitude(
    software: FlightSoftware,
    measurements: Measurements,
    view_of: ViewOf,
    exposure: Exposure | None,
    orbit: OrbitEstimate,
    innovation: Innovation,
) -> OrbitEstimate:
    """Estimate with the attitude of the target given up where landmarks contradict it, and found where unknown."""
    params = software.params
    if params.target is None or orbit.relative.target is None:
        return orbit
    relative, used = orbit.relative, innovation.sensors[LANDMARKS].accepted
    picture = landmark_measurement.picture(
        params.sensors[LANDMARKS], view_of(LANDMARKS, relative), measurements.additional
    )
    contradicted = landmark_measurement.contradicts(picture, used)
    place = relative.layout["attitude"]
    variance = jnp.diagonal(relative.covariance[place, place])
    changes = relative_filter_state.landmark_decay_rate(params.navigation, relative, relative.r_TS_N, relative.v_TS_N)
    renewal = None if changes is None else 1.0 - jnp.exp(-software.tick_s * changes)
    shown = variance, used, contradicted
    reference, lost = target_attitude_ekf.given_up(orbit.relative.target, *shown, software.tick_s, renewal)
    reference = target_attitude_ekf.agreed_after(reference, used, renewal)
    # A wrong attitude has moved the target, too.
    added = relative_orbit_ekf.recovery_variance(params.navigation, relative.layout, relative.r_TS_N, lost)
    relative = replace(relative, target=reference, covariance=relative.covariance + jnp.diag(added))
    states = relative_filter_state.states_with([LANDMARKS, LANDMARK_NETWORK], ())
    of_body = [state.name for state in states if state.name in relative.slow]
    relative = relative_filter_state.reset_to_prior(params.navigation, relative, of_body, lost)
    relative = retrodiction.to_exposure(relative, exposure)
    relative = symmetric_landmarks.weighed(params.navigation, params.target, relative, picture, used)
    relative = landmark_measurement.acquired(params.navigation, params.target, relative, picture)
    return replace(orbit, relative=retrodiction.from_exposure(relative, exposure))


def _exposures(
    software: FlightSoftware, history: History | None, q_BN: Float[Array, "4"], measurements: Measurements
) -> dict[str, Exposure]:
    """Exposures of the sensors whose measurements are late, by name; none where it takes them for those of now."""
    if history is None:
        return {}
    return {name: retrodiction.exposure(history, q_BN, age, software.tick_s) for name, age in measurements.age.items()}


def _recovered(
    params: FlightParams, memory: FlightMemory, orbit: OrbitEstimate, innovation: Innovation, interval: Scalar
) -> tuple[OrbitEstimate, dict[str, Array]]:
    """Estimate, widened where a sensor was rejected for long and nothing else was used; times of rejections [s]."""
    relative, rejected_s, used = orbit.relative, {}, innovation.is_used(("box", *memory.rejected_s))
    for name in memory.rejected_s:
        before = jnp.where(has_widened(params, memory.rejected_s[name]), 0.0, memory.rejected_s[name])
        rejected_s[name] = jnp.where(used, 0.0, before + jnp.where(innovation.sensors[name].rejected, interval, 0.0))
        recover = has_widened(params, rejected_s[name])
        added = relative_orbit_ekf.recovery_variance(params.navigation, relative.layout, relative.r_TS_N, recover)
        relative = replace(relative, covariance=relative.covariance + jnp.diag(added))
    return (replace(orbit, relative=relative) if rejected_s else orbit), rejected_s


def has_widened(params: FlightParams, rejected_s: Scalar) -> Bool[Array, ""]:
    """Whether a sensor has been rejected for so long [s] that the estimate is widened."""
    return rejected_s >= params.navigation.recovery_after - outlier_gate.ROUNDING


def filtered_box(
    params: FlightParams, before: FlightMemory, attitude_variance: Scalar, box: BoxMeasurement, sun_N: Vector
) -> BoxMeasurement:
    """Box as the orbit filter gets it, by the memory before the update and the variance [rad^2] after it.

    It is ignored while the target should be dark, with the Sun at `sun_N` [m].
    """
    cone = line_of_sight_uncertainty.uncertainty_cone(before.orbit, params.pointing.search_sigmas)
    tolerance = jnp.maximum(cone, target_visibility.VISIBILITY_TOLERANCE)
    q_BN = before.attitude.q_BN
    visible = target_visibility.is_visible(params.vehicle, before.orbit, sun_N, tolerance, q_BN)
    # Absolute: when the star tracker returns, the bearing bias learnt under drift is as wrong.
    variance_change = jnp.abs(attitude_variance - before.attitude_variance)
    if params.wide_lens is not None and before.lens is not None:
        variance_change = variance_change + lens_choice.misalignment_variance(params.wide_lens, before.lens)
    return replace(
        box.only_where(visible),
        expected=box.expected & target_visibility.is_visible(params.vehicle, before.orbit, sun_N, q_BN=q_BN),
        attitude_variance_change=variance_change,
    )


def camera_attitude(vehicle: VehicleModel, q_BN: Float[Array, "4"]) -> Float[Array, "4"]:
    """Attitude of the camera of a servicer with an attitude."""
    return quaternion.multiply(quaternion.normalize(vehicle.camera_mounting), q_BN)


def _health_evidence(
    memory: FlightMemory,
    after: FlightMemory,
    innovation: Innovation,
    adaptation: Adaptation,
    interval: Scalar,
    time: Scalar,
) -> HealthEvidence:
    """Evidence by the update of the orbit filter at `time` [s], `interval` [s] after the one before it."""
    orbit, ignition, cutoff = after.orbit, memory.plan.ignition, memory.plan.cutoff
    effort = control_effort.update(
        memory.health.effort,
        memory.orbit.relative,
        orbit.relative,
        burn_begins=(time >= ignition) & (time - interval < ignition) & (cutoff > ignition),
        inflated=after.gate.recovered,
    )
    return HealthEvidence(
        interval=interval,
        innovation=innovation,
        gate=after.gate,
        estimate=orbit.relative,
        effort=effort,
        lasting=adaptation.priors,
        lasting_ratio=adaptation.ratio,
        unseen_time=memory.pointing.acquisition.unseen_time,
        range_sigma=line_of_sight_uncertainty.relative_range_sigma(orbit),
    )


def _attitude_variance(vehicle: VehicleModel, estimate: AttitudeEstimate) -> Scalar:
    """Variance of the camera's attitude [rad^2], mean of the two axes across its boresight."""
    q_BK = quaternion.conjugate(quaternion.normalize(vehicle.camera_mounting))
    boresight = quaternion.rotate(q_BK, jnp.array([0.0, 0.0, 1.0], dtype=q_BK.dtype))
    P = estimate.covariance[:3, :3]
    return 0.5 * (P[0, 0] + P[1, 1] + P[2, 2] - jnp.sum(boresight * apply(P, boresight), axis=0))


def guide(
    software: FlightSoftware, memory: FlightMemory, seen: Bool[Array, ""], sun_N: Vector, time: Scalar
) -> tuple[FlightMemory, Array]:
    """Memory with the attitude reference for the next tick, and the pointing mode.

    `seen` says that a sensor has shown the target at `time` [s]; the Sun is at `sun_N` [m].
    """
    params, guidance = software.params, software.guidance
    plan = burn_schedule.inhibit(guidance, memory.plan, memory.attitude.q_BN, time)
    tick = GuidanceTick(
        time=time,
        estimate=memory.orbit,
        plan=plan,
        sighting=Sighting(seen=seen, promising=outlier_gate.is_promising(params.navigation, memory.gate)),
        visible=_may_be_visible(params, memory.orbit, sun_N),
        other=mission_decision.other_pointing(software, memory, sun_N),
    )
    pointing, mode = attitude_guidance.guide(guidance, memory.pointing, tick)
    reopened = pointing.search_failed & ~burn_conditions.may_be_too_small(params, memory)
    orbit = replace(memory.orbit, relative=relative_filter_state.reopen(memory.orbit.relative, reopened))
    return replace(memory, plan=plan, pointing=pointing, orbit=orbit, reopened=reopened), mode


def _may_be_visible(params: FlightParams, estimate: OrbitEstimate, sun_N: Vector) -> Bool[Array, ""]:
    """Whether the target may be visible by the uncertain estimate, the Sun at `sun_N` [m]."""
    cone = line_of_sight_uncertainty.uncertainty_cone(estimate, params.pointing.search_sigmas)
    tolerance = jnp.maximum(cone - target_visibility.VISIBILITY_TOLERANCE, 0.0)
    return target_visibility.is_in_sight(params.vehicle, estimate, sun_N, tolerance)


def control_attitude(
    software: FlightSoftware, memory: FlightMemory, wheel_speed: Vector, age: Scalar, time: Scalar
) -> Vector:
    """Wheel torque commands [N m] at `time` [s], `age` [s] after the last guidance tick."""
    params = software.params
    return software.stages.call(
        "wheel_torque",
        memory.own,
        control=params.attitude_control,
        vehicle=params.vehicle,
        allocation=memory.wheel_allocation,
        estimate=memory.attitude,
        command=fusion_barrier(slew_profile.evaluate(memory.pointing.reference, age), age),
        wheel_speed=wheel_speed,
        orbit=memory.orbit,
        time=time,
    )


def command_camera(software: FlightSoftware, memory: FlightMemory, time: Scalar) -> FlightMemory:
    """Memory with lens and command for an exposure at `time` [s], to which the estimates have been propagated."""
    params, lens = software.params, memory.lens
    if params.wide_lens is not None and lens is not None:
        lens = lens_choice.next_lens(params.wide_lens, lens, _distance(memory.orbit))
        params = params.seen_through(lens)
    command = software.stages.call(
        "detector_window",
        memory.own,
        camera=software.camera,
        vehicle=params.vehicle,
        target_size=params.navigation.target_size,
        orbit=memory.orbit,
        attitude=memory.attitude,
        pointing=memory.pointing,
        time=time,
    )
    return replace(memory, camera=command, lens=lens)
