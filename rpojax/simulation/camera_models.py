"""Camera of a run by the model of the scenario: exposure, detector window, and box measurement."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import lamp, lens_distortion, quaternion, random_streams
from rpojax.core.constants import RADIUS_EARTH
from rpojax.core.numerics.fusion_barrier import fusion_barrier
from rpojax.core.numerics.gradient_safe import normalize
from rpojax.core.orbits import camera_visibility, earth_rotation, eclipse
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import replace
from rpojax.flight.guidance.detector_window import CameraCommand, CameraFormat
from rpojax.physics.equipment_faults import Health
from rpojax.physics.plant_state import Truth
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors import (
    camera_pose,
    detector_input,
    geometric_camera,
    rendered_camera,
    statistical_camera,
    statistical_landmarks,
    view_features,
)
from rpojax.sensors.additional.landmark_scene import FoundInPicture, LandmarkScene
from rpojax.sensors.camera import NEAREST_DEPTH, CameraFrame
from rpojax.simulation.noise import TickNoise
from rpojax.simulation.state import elapsed_time
from rpojax.vision import box_projection, pinhole
from rpojax.vision.imaging.image_formation import ImageWindow, Scene
from rpojax.vision.landmark_network.find_landmarks import IN_SIGHT


def expose(
    scenario: Scenario,
    params: Params,
    truth: Truth,
    command: CameraCommand,
    box_edge_errors: Array | None,
    sky: SunMoonPositions,
    health: Health,
    noise: TickNoise,
    key: Array,
    tick: Array,
) -> tuple[CameraFrame, Array | None]:
    """One frame by the camera model of the scenario, and the picture (p, p, 3) of a rendered camera.

    Args:
        scenario: static settings
        params: parameters of the run
        truth: state of the plant
        command: of the flight software to the camera
        box_edge_errors: (4,) correlated errors of the statistical camera, None for other cameras
        sky: positions of Sun and Moon
        health: of the equipment
        noise: random numbers of the tick
        key: random key of the image noise
        tick: () ticks since the start
    """
    camera = params.camera
    observable, by_lamp_alone = _light(params, truth, sky)
    # All vertices use the pose: the barrier keeps XLA from recomputing it for each.
    pose = fusion_barrier(camera_pose.target_pose_in_camera(camera, truth.q_TN, truth.r_ST_N, truth.q_BN), tick)
    hull_K = camera_pose.hull_in_camera(params.plant.target.true_hull, *pose)
    size = (scenario.width_px, scenario.height_px)
    normals, uniforms = noise.camera, noise.uniforms
    if scenario.camera_model == "geometric":
        lit = (observable, health.camera)
        return geometric_camera.measure(camera, *size, hull_K, *lit, normals[:4], uniforms[:6]), None
    outline, in_front = _outline(scenario, params, hull_K)
    scene = _scene(scenario, params, truth, sky, tick)
    light_and_health = (observable, health.camera)
    if scenario.camera_model == "statistical":
        assert params.statistics is not None
        assert box_edge_errors is not None
        if by_lamp_alone is not None:
            scene = _under_the_lamp(scene, by_lamp_alone)
        frame = statistical_camera.measure(
            params.statistics, scene, outline, in_front, size, *light_and_health, box_edge_errors, normals, uniforms
        )
        return frame, None
    assert params.networks is not None
    view = commanded_window(scenario, params, command)
    if scenario.temperature is not None:
        # The derivative of a picture by its pose is left out: the box moves with the outline.
        view, scene = jax.lax.stop_gradient((view, scene))
    picture = _render_window(scenario, params, view, scene, key)
    seen = (params.imaging, params.networks, view, picture, size, outline)
    frame = rendered_camera.measure(*seen, *light_and_health, scenario.temperature)
    return frame, picture


def _outline(
    scenario: Scenario, params: Params, hull_K: Float[Array, "n 3"]
) -> tuple[Float[Array, "4"], Bool[Array, ""]]:
    """Edges [px] of the target's outline, and whether all of the target is in front of the camera."""
    in_front = jnp.min(hull_K[:, 2], axis=0) > NEAREST_DEPTH
    return jnp.where(in_front, box_projection.projected_box(_lens(scenario, params), hull_K), 0.0), in_front


def _light(params: Params, truth: Truth, sky: SunMoonPositions) -> tuple[Bool[Array, ""], Bool[Array, ""] | None]:
    """Whether there is light to see the target by, and whether it is that of the lamp alone; None without one."""
    camera = params.camera
    conditions = (truth.r_TN_N, truth.r_ST_N, sky.sun_N, camera.phase_limit, camera.sun_exclusion)
    if params.lamp is None:
        return camera_visibility.is_observable(*conditions), None
    lamplit = lamp.lights(params.lamp, quaternion.rotate(truth.q_BN, -truth.r_ST_N))
    by_sun, by_lamp = camera_visibility.light_sources(*conditions, lamplit)
    return by_sun | by_lamp, by_lamp & ~by_sun


def _under_the_lamp(scene: Scene, by_lamp_alone: Bool[Array, ""]) -> Scene:
    """The scene with the light of the lamp in place of the Sun's: from the camera, at a phase angle of zero."""
    return replace(
        scene,
        sun_T=jnp.where(by_lamp_alone, normalize(scene.r_KT_T), scene.sun_T),
        sunlight=jnp.where(by_lamp_alone, 1.0, scene.sunlight),
    )


def landmarks_in_view(
    scenario: Scenario, params: Params, truth: Truth, sky: SunMoonPositions, health: Health
) -> LandmarkScene:
    """Landmarks of the target before the camera, with the light that it has."""
    assert params.landmarks is not None
    observable, by_lamp_alone = _light(params, truth, sky)
    R_KT, r_TK_K = camera_pose.target_pose_in_camera(params.camera, truth.q_TN, truth.r_ST_N, truth.q_BN)
    nominal = params.flight.vehicle.focal_px
    size = jnp.array([scenario.width_px, scenario.height_px], dtype=nominal.dtype)
    return LandmarkScene(
        landmarks=params.landmarks,
        scale=params.plant.target.scale,
        R_KT=R_KT,
        r_TK_K=r_TK_K,
        sun_T=quaternion.rotate(truth.q_TN, normalize(sky.sun_N)),
        focal_px=_lens(scenario, params).focal_px,
        nominal_focal_px=nominal,
        half_frame_tangent=0.5 * size / nominal,
        distortion=params.camera.distortion,
        nominal_distortion=params.flight.vehicle.distortion,
        observable=observable,
        by_lamp_alone=jnp.zeros((), dtype=bool) if by_lamp_alone is None else by_lamp_alone,
        working=health.camera,
    )


def landmarks_drawn(
    scenario: Scenario,
    params: Params,
    truth: Truth,
    sky: SunMoonPositions,
    tick: Array,
    frame: CameraFrame,
    view: LandmarkScene,
    noise: tuple[Float[Array, " m"], Float[Array, " n"]],
) -> FoundInPicture:
    """Landmarks that a statistical camera finds where it has a box; `noise` are lasting errors and normal numbers."""
    assert params.statistics is not None
    assert params.statistics.landmarks is not None
    statistics, (lasting, normals) = params.statistics.landmarks, noise
    count = statistical_landmarks.normal_count(view.landmarks.positions.shape[0])
    scene, size = _scene(scenario, params, truth, sky, tick), (scenario.width_px, scenario.height_px)
    pose = camera_pose.target_pose_in_camera(params.camera, truth.q_TN, truth.r_ST_N, truth.q_BN)
    outline, _ = _outline(scenario, params, camera_pose.hull_in_camera(params.plant.target.true_hull, *pose))
    scene = _under_the_lamp(scene, view.by_lamp_alone)
    return statistical_landmarks.draw(
        statistics,
        view,
        params.mesh_offset,
        view_features.features(scene, outline.astype(jnp.float32), size),
        view_features.visible_outline(outline, size)[1],
        frame.box.present & ~frame.outlier,
        lasting[:count],
        normals[:count],
    )


def landmarks_found(
    scenario: Scenario, params: Params, command: CameraCommand, picture: Float[Array, "p p 3"], frame: CameraFrame
) -> FoundInPicture:
    """Landmarks that the network finds in a rendered picture with a box, by the focal length of flight software."""
    assert params.networks is not None
    view, size = commanded_window(scenario, params, command), (scenario.width_px, scenario.height_px)
    found = rendered_camera.landmarks_in_picture(params.networks, view, picture, frame.box.edges, size)
    focal = params.flight.vehicle.focal_px
    middle = 0.5 * jnp.array(size, dtype=focal.dtype)
    shown = (found.places.astype(focal.dtype) - middle[None]) / focal
    tangents = lens_distortion.undistort(params.flight.vehicle.distortion, shown[:, 0], shown[:, 1])
    return FoundInPicture(
        tangents=jnp.stack(tangents, axis=1),
        sigma=found.sigma.astype(focal.dtype) / focal,
        present=frame.box.present & (found.visible_probability > IN_SIGHT),
    )


def camera_format(scenario: Scenario) -> CameraFormat:
    """Sizes of the camera's images."""
    size = (scenario.width_px, scenario.height_px)
    return CameraFormat(*size, input_px=detector_input.input_side(*size))


def commanded_window(scenario: Scenario, params: Params, command: CameraCommand) -> ImageWindow:
    """Window of the frame that a command selects."""
    return detector_input.window_at(_lens(scenario, params), command.corner_px, command.binning)


def recorded_window(scenario: Scenario, params: Params, window_px: Float[Array, "3"]) -> ImageWindow:
    """Window from the recorded left, top and side [px], float32."""
    binning = window_px[2] / detector_input.input_side(scenario.width_px, scenario.height_px)
    return detector_input.window_at(_lens(scenario, params), window_px[:2], binning)


def render_picture(
    scenario: Scenario, params: Params, view: ImageWindow, truth: Truth, sky: SunMoonPositions, key: Array, tick: Array
) -> Float[Array, "p p 3"]:
    """Image of a window as `expose` renders it, sRGB codes in 0..1."""
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
    q_KN = camera_pose.camera_attitude(params.camera, truth.q_BN)
    q_KT = quaternion.multiply(q_KN, quaternion.conjugate(truth.q_TN))
    sun_N = normalize(sky.sun_N)
    time = params.epoch.seconds + elapsed_time(scenario, truth, tick)
    scene = Scene(
        # A target of twice the size looks as the nominal one from half the distance.
        r_KT_T=(quaternion.rotate(truth.q_TN, truth.r_ST_N) - params.mesh_offset) / params.plant.target.scale,
        R_KT=quaternion.to_matrix(q_KT),
        sun_T=quaternion.rotate(truth.q_TN, sun_N),
        sunlight=eclipse.illumination(truth.r_TN_N, sky.sun_N),
        R_KN=quaternion.to_matrix(q_KN),
        position_N=(truth.r_TN_N + truth.r_ST_N) / RADIUS_EARTH,
        sun_N=sun_N,
        earth_rotation=earth_rotation.earth_rotation_angle(time),
        smear=_smear(params, truth),
    )
    return rendered_camera.to_float32(scene)


def _lens(scenario: Scenario, params: Params) -> pinhole.Intrinsics:
    return params.camera.lens(scenario.width_px, scenario.height_px)


def _smear(params: Params, truth: Truth) -> Float[Array, "2"] | None:
    """Way of the target in the picture during the exposure, as tangents; None where the exposure has no length.

    By the motion of the target past the camera and the turn of the camera; that of the target itself is left out.
    """
    if params.imaging.exposure_time is None:
        return None
    q_KN = camera_pose.camera_attitude(params.camera, truth.q_BN)
    q_KB = quaternion.multiply(q_KN, quaternion.conjugate(truth.q_BN))
    r_TK_K, v_TS_K = quaternion.rotate(q_KN, -truth.r_ST_N), quaternion.rotate(q_KN, -truth.v_ST_N)
    omega_K = quaternion.rotate(q_KB, truth.omega_BN_B)
    velocity = v_TS_K - jnp.cross(omega_K, r_TK_K)
    depth = jnp.maximum(r_TK_K[2], NEAREST_DEPTH)
    rate = (velocity[:2] - r_TK_K[:2] / depth * velocity[2]) / depth
    return params.imaging.exposure_time * rate


def boresight_N(params: Params, truth: Truth) -> Float[Array, "3"]:
    """True boresight of the camera in N."""
    q_KN = camera_pose.camera_attitude(params.camera, truth.q_BN)
    return quaternion.rotate(quaternion.conjugate(q_KN), jnp.array([0.0, 0.0, 1.0], dtype=q_KN.dtype))
