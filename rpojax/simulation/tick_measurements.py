"""Measurements of one tick by all sensors, and propagation of the correlated sensor errors."""

from typing import Any, Final

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import lens_distortion, quaternion, vectors
from rpojax.core.declared_numbers import declared_numbers
from rpojax.core.numerics import double_single, gradient_safe
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import pytree, replace
from rpojax.flight.computer import LANDMARKS
from rpojax.flight.flight_records import Measurements
from rpojax.flight.guidance.detector_window import CameraCommand
from rpojax.flight.guidance.lens_choice import LensInUse
from rpojax.flight.guidance.sight_cone import sight_cone
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, GpsMeasurement
from rpojax.physics.equipment_faults import Health
from rpojax.physics.plant_state import Truth
from rpojax.physics.thruster import BurnError
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors import (
    chamber_pressure,
    gps,
    gyro,
    measurement_delay,
    star_tracker,
    statistical_camera,
    statistical_landmarks,
)
from rpojax.sensors.additional.additional_sensor import SensedScene
from rpojax.sensors.additional.landmark_scene import LandmarkScene
from rpojax.sensors.camera import CameraFrame
from rpojax.sensors.gps import Gps
from rpojax.sensors.measurement_delay import Delivery, InTransit, MeasurementDelay
from rpojax.simulation import camera_models
from rpojax.simulation.noise import TickNoise, camera_key
from rpojax.simulation.state import SensorErrors, State
from rpojax.simulation.tick import Loop
from rpojax.vision import bounding_box

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]

CAMERA: Final = "camera"
"""Name of the camera among the sensors whose measurements may be late."""


@pytree
class SeenByCamera:
    """What flight software gets of an exposure of the camera.

    Attributes:
        box: bounding box
        frame: what is recorded of it
        picture: (p, p, 3) that the detector got, None where no stage asks for it
        window: of the picture, likewise
        is_wide: () bool, through the wide lens; None with one lens
    """

    box: BoxMeasurement
    frame: CameraFrame
    picture: Array | None
    window: CameraCommand | None
    is_wide: Array | None


def measure(
    loop: Loop,
    state: State,
    noise: TickNoise,
    sky: SunMoonPositions,
    health: Health,
    time: Scalar,
) -> tuple[Measurements, CameraFrame, dict[str, InTransit]]:
    """Inputs of the flight software at the beginning of a tick, at `time` [s]; camera frame; what is under way."""
    params, truth = loop.params, state.truth
    exposed = expose(loop, state, noise, sky, health, time)
    arrived, in_transit, age = _exchange_late(loop, state, exposed, noise)
    seen: SeenByCamera = arrived.pop(CAMERA)
    measurements = Measurements(
        gps=measure_position(params.gps, truth, state.sensor_errors.gps_bias_N, noise.gps, health),
        star_tracker_q_BN=star_tracker.measure(params.star_tracker, truth.q_BN, noise.star_tracker),
        star_tracker_present=health.star_tracker
        & star_tracker.is_available(params.star_tracker, truth.q_BN, sky.sun_N),
        box=seen.box,
        additional={key: value for channels in arrived.values() for key, value in channels.items()},
        picture=seen.picture,
        age=age,
        is_wide=seen.is_wide,
        window=seen.window,
    )
    return measurements, seen.frame, in_transit


def expose(
    loop: Loop, state: State, noise: TickNoise, sky: SunMoonPositions, health: Health, time: Scalar
) -> dict[str, Any]:
    """Measurements whose exposure is at `time` [s], of each sensor that may be late, by name.

    That of the camera is `SeenByCamera`.
    """
    scenario, params, truth = loop.scenario, loop.params.seen_through(state.flight.lens), state.truth
    frame, picture = camera_models.expose(
        scenario,
        params,
        truth,
        state.flight.camera,
        state.sensor_errors.box_edge_errors,
        sky,
        health,
        noise,
        camera_key(state.keys, state.tick),
        state.tick,
    )
    takes, lens = loop.stages.takes_picture, state.flight.lens
    of_camera = SeenByCamera(
        box=box_measurement(scenario, params, frame),
        frame=frame,
        picture=picture if takes else None,
        window=state.flight.camera if takes else None,
        is_wide=None if lens is None else lens.is_wide,
    )
    return {CAMERA: of_camera, **_measure_additional(loop, state, noise, sky, health, time, (picture, frame))}


def _exchange_late(
    loop: Loop, state: State, exposed: dict[str, Any], noise: TickNoise
) -> tuple[dict[str, Any], dict[str, InTransit], dict[str, Array]]:
    """What flight software gets of each sensor in the tick of an exposure, what is under way, and ages [s]."""
    in_transit, arrived, age = dict(state.in_transit), dict(exposed), {}
    for name, waiting in state.in_transit.items():
        delay, uniform = _delay_of(loop.params, name), noise.delays[name]
        in_transit[name], delivery = measurement_delay.pass_through(
            waiting, delay, exposed[name], state.tick, uniform, loop.scenario.tick_s
        )
        age[name], present = delivery.age, delivery.present
        if name == CAMERA:
            arrived[name] = _as_present(delivery, state.flight.lens)
        else:
            arrived[name] = measurement_delay.without_measurement(delivery.measurement, present)
    return arrived, in_transit, age


def _as_present(delivery: Delivery, lens: LensInUse | None) -> SeenByCamera:
    """What arrived of the camera, or what stands for nothing: that does not tell that there is no target.

    A frame counts for the time since the one that flight software had before it, a tick without one for none.
    """
    seen, present = delivery.measurement, delivery.present
    box = replace(
        seen.box.only_where(present),
        expected=seen.box.expected & present,
        interval=jnp.where(present, delivery.interval, 0.0),
    )
    of_frame = replace(seen.frame.box, present=seen.frame.box.present & present)
    frame = replace(
        seen.frame,
        box=of_frame,
        observable=seen.frame.observable & present,
        outlier=seen.frame.outlier & present,
        score=jnp.where(present, seen.frame.score, jnp.zeros_like(seen.frame.score)),
    )
    if lens is None or seen.is_wide is None:
        return replace(seen, box=box, frame=frame)
    return replace(seen, box=box, frame=frame, is_wide=jnp.where(present, seen.is_wide, lens.was_wide))


def _delay_of(params: Params, name: str) -> MeasurementDelay:
    if name == CAMERA:
        return params.camera_delay
    numbers = params.additional_sensors[name]
    return MeasurementDelay(**{each: numbers[each] for each in declared_numbers(MeasurementDelay)})


def box_measurement(scenario: Scenario, params: Params, frame: CameraFrame) -> BoxMeasurement:
    """Box as measured by the flight software, with focal length and lens of its vehicle model."""
    focal, distortion = params.flight.vehicle.focal_px, params.flight.vehicle.distortion
    center_px = jnp.array([0.5 * scenario.width_px, 0.5 * scenario.height_px], dtype=focal.dtype)
    edges = frame.box.edges
    if distortion is not None:
        edges = _corrected_edges(distortion, edges, center_px, focal)
    side = bounding_box.box_size(edges)
    return BoxMeasurement(
        tangent=(bounding_box.box_center(edges) - center_px) / focal,
        log_size=jnp.log(side / focal),
        log_aspect=bounding_box.log_aspect_ratio(edges),
        side_px=side,
        present=frame.box.present,
        expected=jnp.ones_like(frame.box.present),
        truncated=frame.box.truncated,
        half_frame_tangent=center_px / focal,
        attitude_variance_change=jnp.zeros_like(side),
        interval=jnp.full_like(side, scenario.tick_s),
        weight=frame.weight,
    )


def _corrected_edges(
    distortion: Float[Array, "5"], edges: Float[Array, "4"], center_px: Float[Array, "2"], focal_px: Float[Array, ""]
) -> Float[Array, "4"]:
    """Edges [px] of a box corrected for the lens, each at its middle."""
    left, top, right, bottom = edges
    across, down = bounding_box.box_center(edges)
    x = (jnp.stack([left, across, right, across]) - center_px[0]) / focal_px
    y = (jnp.stack([down, top, down, bottom]) - center_px[1]) / focal_px
    x, y = lens_distortion.undistort(distortion, x, y)
    return jnp.concatenate([center_px, center_px]) + focal_px * jnp.stack([x[0], y[1], x[2], y[3]])


def _measure_additional(
    loop: Loop,
    state: State,
    noise: TickNoise,
    sky: SunMoonPositions,
    health: Health,
    time: Scalar,
    exposed: tuple[Array | None, CameraFrame],
) -> dict[str, dict[str, Array]]:
    """Measurements of the additional sensors, by sensor and name; `exposed` are picture and frame of the camera."""
    scenario, params, flight = loop.scenario, loop.params, state.flight
    scene = SensedScene(truth=state.truth, sky=sky, time=time)
    if params.surface is not None:
        cone = sight_cone(params.flight.navigation, flight.orbit, flight.attitude.q_BN)
        scene = replace(scene, surface=replace(params.surface, scale=params.plant.target.scale), cone=cone)
    if params.landmarks is not None:
        seen_through = params.seen_through(flight.lens)
        view = camera_models.landmarks_in_view(scenario, seen_through, state.truth, sky, health)
        scene = replace(scene, landmarks=_with_found(loop, state, noise, sky, view, exposed))
    return {
        name: sensor.measure(params.additional_sensors[name], scene, noise.additional[name])
        for name, sensor in scenario.additional_sensors
    }


def _with_found(
    loop: Loop,
    state: State,
    noise: TickNoise,
    sky: SunMoonPositions,
    view: LandmarkScene,
    exposed: tuple[Array | None, CameraFrame],
) -> LandmarkScene:
    """Landmarks with what a network finds of them in the picture, or what the statistics of one say."""
    scenario, params, (picture, frame) = loop.scenario, loop.params.seen_through(state.flight.lens), exposed
    if picture is not None:
        found = camera_models.landmarks_found(scenario, params, state.flight.camera, picture, frame)
        return replace(view, found=found)
    lasting = state.sensor_errors.landmark_errors
    if lasting is None:
        return view
    numbers = lasting, noise.additional[LANDMARKS]
    found = camera_models.landmarks_drawn(scenario, params, state.truth, sky, state.tick, frame, view, numbers)
    return replace(view, found=found)


def measure_position(receiver: Gps, truth: Truth, bias_N: Vector, normals: Vector, health: Health) -> GpsMeasurement:
    """Position of the servicer by a GPS receiver with a slow error `bias_N` [m], from standard normal numbers (3,)."""
    if truth.orbit_low is None:
        position_N, residue_N = gps.measure(receiver, truth.r_TN_N + truth.r_ST_N, bias_N, normals), None
    else:
        from_target_N = gps.measure(receiver, truth.r_ST_N, bias_N, normals)
        position_N, residue_N = double_single.add(truth.r_TN_N, truth.orbit_low[0], from_target_N)
    return GpsMeasurement(position_N=position_N, position_low_N=residue_N, present=health.gps)


def measure_chamber_pressure(params: Params, noise: TickNoise, burn_error: BurnError, health: Health) -> Scalar:
    """Measured chamber pressure as a fraction of the nominal one."""
    thrust = params.plant.thruster.force_scale * (1.0 + burn_error.magnitude) * health.thrust_fraction
    return chamber_pressure.measure(params.chamber_pressure, thrust, noise.chamber_pressure)


def advance_sensor_errors(scenario: Scenario, params: Params, state: State, noise: TickNoise) -> SensorErrors:
    """Correlated sensor errors one tick later."""
    box_edges, params = state.sensor_errors.box_edge_errors, params.seen_through(state.flight.lens)
    if box_edges is not None:
        assert params.statistics is not None
        assert noise.box_edge_errors is not None
        turned = gradient_safe.norm(state.truth.omega_TN_T) * scenario.tick_s
        box_edges = statistical_camera.advance_correlated_error(
            params.statistics, box_edges, turned, noise.box_edge_errors
        )
    landmarks = state.sensor_errors.landmark_errors
    if landmarks is not None:
        assert params.statistics is not None
        assert params.statistics.landmarks is not None
        assert noise.landmark_errors is not None
        turned = scenario.tick_s * turn_rate_before_camera(state.truth)
        angle = params.statistics.landmarks.lasting_angle
        landmarks = statistical_landmarks.advance(angle, landmarks, turned, noise.landmark_errors)
    return SensorErrors(
        gps_bias_N=gps.advance_bias(params.gps, state.sensor_errors.gps_bias_N, noise.biases[:3], scenario.tick_s),
        gyro_bias_B=gyro.advance_bias(params.gyro, state.sensor_errors.gyro_bias_B, noise.biases[3:], scenario.tick_s),
        box_edge_errors=box_edges,
        landmark_errors=landmarks,
    )


def turn_rate_before_camera(truth: Truth) -> Scalar:
    """Rate at which the target turns from the line of sight [rad/s]: how the camera points does not change its view."""
    of_line_N = vectors.line_of_sight_rate(truth.r_ST_N, truth.v_ST_N)
    return gradient_safe.norm(truth.omega_TN_T - quaternion.rotate(truth.q_TN, of_line_N))
