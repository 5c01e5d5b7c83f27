"""What the camera of a run sees, by the model that the scenario asks for, and its box as flight software gets it."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import quaternion, random_streams
from rpojax.core.constants import RADIUS_EARTH
from rpojax.core.numerics.fusion_barrier import fusion_barrier
from rpojax.core.numerics.safe import normalize
from rpojax.core.orbits import eclipse, sun_moon_ephemeris
from rpojax.flight.computer import FlightMemory
from rpojax.flight.navigation.filter_tuning import BoxMeasurement
from rpojax.physics.environment import SunMoonPositions
from rpojax.physics.equipment_faults import Health
from rpojax.physics.plant import Truth
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.sensors import geometric_camera, rendered_camera, statistical_camera
from rpojax.sensors.geometric_camera import CameraFrame
from rpojax.simulation.noise import TickNoise
from rpojax.vision import bounding_box, pinhole
from rpojax.vision.imaging.image_formation import ImageWindow, Scene

_TRACKING_TIMEOUT_S = 5.0
"""A target seen so recently is looked for where it is expected."""


def expose(
    scenario: Scenario,
    params: Params,
    truth: Truth,
    flight: FlightMemory,
    box_edge_errors: Array | None,
    sky: SunMoonPositions,
    health: Health,
    noise: TickNoise,
    key: Array,
    tick: Array,
) -> CameraFrame:
    """One exposure by the scenario's camera model; `box_edges` is what lasts of the statistical camera's errors.

    `key` is for the noise of a picture's pixels.
    """
    camera = params.camera
    observable = eclipse.is_observable(truth.r_TN_N, truth.r_ST_N, sky.sun_N, camera.phase_limit, camera.sun_exclusion)
    # Every vertex needs the same rotation.
    placed = fusion_barrier(geometric_camera.target_pose_in_camera(camera, truth.q_TN, truth.r_ST_N, truth.q_BN), tick)
    hull_K = geometric_camera.hull_in_camera(params.plant.target.hull, *placed)
    size = (scenario.width_px, scenario.height_px)
    normals, uniforms = noise.camera, noise.uniforms
    if scenario.camera_model == "geometric":
        return geometric_camera.measure(camera, *size, hull_K, observable, health.camera, normals[:4], uniforms[:6])
    in_front = jnp.min(hull_K[:, 2], axis=0) > 0.1
    outline = jnp.where(in_front, bounding_box.projected_box(_lens(scenario, params), hull_K), 0.0)
    scene = _scene(scenario, params, truth, sky, tick)
    light_and_health = (observable, health.camera)
    if scenario.camera_model == "statistical":
        assert params.statistics is not None
        assert box_edge_errors is not None
        return statistical_camera.measure(
            params.statistics, scene, outline, in_front, size, *light_and_health, box_edge_errors, normals, uniforms
        )
    assert params.networks is not None
    view = detector_window(scenario, params, flight)
    picture = _render_window(scenario, params, view, scene, key)
    return rendered_camera.measure(params.imaging, params.networks, view, picture, size, outline, *light_and_health)


def detector_window(scenario: Scenario, params: Params, flight: FlightMemory) -> ImageWindow:
    """The part of the frame that flight software hands to the detector."""
    onboard, navigation = params.flight.vehicle, params.flight.navigation
    q_KN = quaternion.multiply(quaternion.normalize(onboard.camera_mounting), flight.attitude.q_BN)
    r_TK_K = quaternion.rotate(q_KN, flight.orbit.relative.r_TS_N)
    lens = pinhole.Intrinsics(
        focal_px=onboard.focal_px,
        center_px=jnp.array([0.5 * scenario.width_px, 0.5 * scenario.height_px], dtype=jnp.float64),
    )
    depth = jnp.maximum(r_TK_K[2], 1e-3)
    expected = lens.center_px + lens.focal_px * r_TK_K[:2] / depth
    tracked = flight.pointing.acquired & (flight.pointing.unseen_time < _TRACKING_TIMEOUT_S) & (r_TK_K[2] > 0.0)
    size = lens.focal_px * navigation.target_size / depth
    true_lens = _lens(scenario, params)
    return rendered_camera.choose_window(true_lens, scenario.width_px, scenario.height_px, expected, size, tracked)


def recorded_window(scenario: Scenario, params: Params, window_px: Float[Array, "3"]) -> ImageWindow:
    """The part of the frame whose left, top and side [px], float32, a frame has recorded."""
    binning = window_px[2] / rendered_camera.input_side(scenario.width_px, scenario.height_px)
    return rendered_camera.window_at(_lens(scenario, params), window_px[:2], binning)


def render_picture(
    scenario: Scenario, params: Params, view: ImageWindow, truth: Truth, sky: SunMoonPositions, key: Array, tick: Array
) -> Float[Array, "p p 3"]:
    """Picture (sRGB codes in 0..1) of a window of the frame, as `expose` looks at it."""
    return _render_window(scenario, params, view, _scene(scenario, params, truth, sky, tick), key)


def _render_window(
    scenario: Scenario, params: Params, view: ImageWindow, scene: Scene, key: Array
) -> Float[Array, "p p 3"]:
    networks, rays = params.networks, scenario.ray_sampling
    assert networks is not None
    assert rays is not None
    size = (scenario.width_px, scenario.height_px)
    return rendered_camera.render_window(
        params.imaging, networks, rays, view, *size, scene, random_streams.fold_in(key, 2)
    )


def _scene(scenario: Scenario, params: Params, truth: Truth, sky: SunMoonPositions, tick: Array) -> Scene:
    q_KN = geometric_camera.camera_attitude(params.camera, truth.q_BN)
    q_KT = quaternion.multiply(q_KN, quaternion.conjugate(truth.q_TN))
    sun_N = normalize(sky.sun_N)
    time = scenario.epoch_s + tick.astype(jnp.float64) * scenario.tick_s
    scene = Scene(
        r_KT_T=quaternion.rotate(truth.q_TN, truth.r_ST_N),
        R_KT=quaternion.to_matrix(q_KT),
        sun_T=quaternion.rotate(truth.q_TN, sun_N),
        sunlight=eclipse.illumination(truth.r_TN_N, sky.sun_N),
        R_KN=quaternion.to_matrix(q_KN),
        position_N=(truth.r_TN_N + truth.r_ST_N) / RADIUS_EARTH,
        sun_N=sun_N,
        earth_rotation=sun_moon_ephemeris.earth_rotation_angle(time),
    )
    return rendered_camera.to_float32(scene)


def _lens(scenario: Scenario, params: Params) -> pinhole.Intrinsics:
    return pinhole.pinhole_intrinsics(params.camera.field_of_view, scenario.width_px, scenario.height_px)


def box_measurement(scenario: Scenario, params: Params, frame: CameraFrame) -> BoxMeasurement:
    """The box in the flight software's terms, with the focal length that flight software believes in."""
    focal = params.flight.vehicle.focal_px
    middle = jnp.array([0.5 * scenario.width_px, 0.5 * scenario.height_px], dtype=jnp.float64)
    side = bounding_box.box_size(frame.box.edges)
    return BoxMeasurement(
        tangent=(bounding_box.box_center(frame.box.edges) - middle) / focal,
        log_size=jnp.log(side / focal),
        side_px=side,
        present=frame.box.present,
        truncated=frame.box.truncated,
        half_frame_tangent=middle / focal,
        attitude_variance_change=jnp.zeros_like(side),
    )
