"""Measurements of one tick by all sensors, and propagation of the correlated sensor errors."""

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import double_single, gradient_safe
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.flight.flight_records import Measurements
from rpojax.flight.guidance.sight_cone import sight_cone
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, GpsMeasurement
from rpojax.physics.equipment_faults import Health
from rpojax.physics.plant_state import Truth
from rpojax.physics.thruster import BurnError
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors import chamber_pressure, gps, gyro, star_tracker, statistical_camera
from rpojax.sensors.additional.additional_sensor import SensedScene
from rpojax.sensors.camera import CameraFrame
from rpojax.sensors.gps import Gps
from rpojax.simulation import camera_models
from rpojax.simulation.noise import TickNoise, camera_key
from rpojax.simulation.state import SensorErrors, State
from rpojax.simulation.tick import Loop
from rpojax.vision import bounding_box

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


def measure(
    loop: Loop,
    state: State,
    noise: TickNoise,
    sky: SunMoonPositions,
    health: Health,
    time: Scalar,
) -> tuple[Measurements, CameraFrame]:
    """Inputs of the flight software at the beginning of a tick, at `time` [s], and the camera frame."""
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
    measurements = Measurements(
        gps=measure_position(params.gps, truth, state.sensor_errors.gps_bias_N, noise.gps, health),
        star_tracker_q_BN=star_tracker.measure(params.star_tracker, truth.q_BN, noise.star_tracker),
        star_tracker_present=health.star_tracker
        & star_tracker.is_available(params.star_tracker, truth.q_BN, sky.sun_N),
        box=box_measurement(scenario, params, frame),
        additional=_measure_additional(loop, state, noise, sky, time),
        picture=picture if loop.stages.takes_picture else None,
    )
    return measurements, frame


def box_measurement(scenario: Scenario, params: Params, frame: CameraFrame) -> BoxMeasurement:
    """Box as measured by the flight software, with the focal length of its vehicle model."""
    focal = params.flight.vehicle.focal_px
    center_px = jnp.array([0.5 * scenario.width_px, 0.5 * scenario.height_px], dtype=focal.dtype)
    side = bounding_box.box_size(frame.box.edges)
    return BoxMeasurement(
        tangent=(bounding_box.box_center(frame.box.edges) - center_px) / focal,
        log_size=jnp.log(side / focal),
        log_aspect=bounding_box.log_aspect_ratio(frame.box.edges),
        side_px=side,
        present=frame.box.present,
        expected=jnp.ones_like(frame.box.present),
        truncated=frame.box.truncated,
        half_frame_tangent=center_px / focal,
        attitude_variance_change=jnp.zeros_like(side),
        interval=jnp.full_like(side, scenario.tick_s),
    )


def _measure_additional(
    loop: Loop, state: State, noise: TickNoise, sky: SunMoonPositions, time: Scalar
) -> dict[str, Array]:
    """Measurements of the additional sensors, by name."""
    scenario, params, flight = loop.scenario, loop.params, state.flight
    scene = SensedScene(truth=state.truth, sky=sky, time=time)
    if params.surface is not None:
        cone = sight_cone(params.flight.navigation, flight.orbit, flight.attitude.q_BN)
        scene = replace(scene, surface=replace(params.surface, scale=params.plant.target.scale), cone=cone)
    found: dict[str, Array] = {}
    for name, sensor in scenario.additional_sensors:
        found |= sensor.measure(params.additional_sensors[name], scene, noise.additional[name])
    return found


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
    return SensorErrors(
        gps_bias_N=gps.advance_bias(params.gps, state.sensor_errors.gps_bias_N, noise.biases[:3], scenario.tick_s),
        gyro_bias_B=gyro.advance_bias(params.gyro, state.sensor_errors.gyro_bias_B, noise.biases[3:], scenario.tick_s),
        box_edge_errors=box_edges,
    )
