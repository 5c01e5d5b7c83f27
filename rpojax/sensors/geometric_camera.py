"""The camera in its geometric form: the target's hull through the pinhole, with the errors that a detector makes."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.pytree import pytree
from rpojax.core.quaternion import rotate
from rpojax.vision import bounding_box, pinhole
from rpojax.vision.bounding_box import BoundingBox

Vector = Float[Array, "3"]

NORMALS_PER_FRAME = 4
"""Standard normal numbers that one frame needs."""
UNIFORMS_PER_FRAME = 6
"""Uniform numbers that one frame needs."""


@pytree
class Camera:
    """Camera with a bounding-box detector, as they are.

    Attributes:
        field_of_view: () horizontal [rad]
        mounting: (4,) nominal q_KB
        misalignment: (3,) small rotation of the camera about its own axes [rad]
        edge_noise: () error of each box edge, 1 sigma [px]
        miss_probability: () share of observable frames without a box [-]
        minimum_size: () smaller targets are not detected [px]
        outlier_probability: () share of frames whose box is false [-]
        outlier_size_min: () [px]
        outlier_size_max: () [px]
        phase_limit: () largest Sun-target-camera angle with a usable image [rad]
        sun_exclusion: () least angle between line of sight and Sun [rad]
    """

    field_of_view: Array
    mounting: Array
    misalignment: Array
    edge_noise: Array
    miss_probability: Array
    minimum_size: Array
    outlier_probability: Array
    outlier_size_min: Array
    outlier_size_max: Array
    phase_limit: Array
    sun_exclusion: Array


@pytree
class CameraFrame:
    """What one exposure yields.

    Attributes:
        box: the box that the flight software gets
        observable: () bool, the light allows to see the target
        score: () 0..1, the detector's in its best box, whether it counts as one or not; 1 or 0 without a detector
        window: (3,) left, top and side [px] of the square that the detector got
        outlier: () bool, the box is false (for bookkeeping only)
        outline: (4,) true left, top, right, bottom of the target, cut to the frame [px] (for bookkeeping only)
    """

    box: BoundingBox
    observable: Array
    score: Array
    window: Array
    outlier: Array
    outline: Array


def camera_attitude(camera: Camera, q_BN: Float[Array, "4"]) -> Float[Array, "4"]:
    """True `q_KN` of the camera on a body at `q_BN`."""
    q_KB = quaternion.multiply(quaternion.exp(camera.misalignment), quaternion.normalize(camera.mounting))
    return quaternion.multiply(q_KB, q_BN)


def measure(
    camera: Camera,
    width_px: int,
    height_px: int,
    hull_K: Float[Array, "n 3"],
    observable: Bool[Array, ""],
    working: Bool[Array, ""],
    normals: Float[Array, "4"],
    uniforms: Float[Array, "6"],
) -> CameraFrame:
    """Box of one exposure of the hull vertices `hull_K` [m] in camera axes; there is none without light.

    `observable` is the light, `working` the camera's health.
    """
    lens = pinhole.pinhole_intrinsics(camera.field_of_view, width_px, height_px)
    true_edges = bounding_box.projected_box(lens, hull_K)
    in_front = jnp.min(hull_K[:, 2], axis=0) > 0.1
    center = bounding_box.box_center(true_edges)
    frame_size = jnp.array([width_px, height_px], dtype=jnp.float64)
    inside = jnp.all((center > 0.0) & (center < frame_size), axis=0)
    sides = true_edges[2:] - true_edges[:2]
    large = jnp.max(sides, axis=0) > camera.minimum_size
    detected = observable & in_front & inside & large & (uniforms[0] >= camera.miss_probability)
    noisy, truncated = bounding_box.clip_to_frame(true_edges + camera.edge_noise * normals, width_px, height_px)

    outlier = uniforms[1] < camera.outlier_probability
    false_edges, false_truncated = bounding_box.clip_to_frame(
        _false_box(camera, frame_size, uniforms[2:]), width_px, height_px
    )
    box = BoundingBox(
        edges=jnp.where(outlier, false_edges, noisy),
        present=(detected | outlier) & observable & working,
        truncated=jnp.where(outlier, false_truncated, truncated),
    )
    visible, _ = bounding_box.clip_to_frame(jnp.where(in_front, true_edges, 0.0), width_px, height_px)
    return CameraFrame(
        box=box,
        observable=observable & working,
        score=jnp.where(box.present, 1.0, 0.0),
        window=jnp.array([0.0, 0.0, max(width_px, height_px)], dtype=jnp.float64),
        outlier=outlier,
        outline=visible,
    )


def _false_box(camera: Camera, frame_size: Float[Array, "2"], uniforms: Float[Array, "4"]) -> Float[Array, "4"]:
    """False box: centre uniform over the frame, sides log-uniform."""
    center = frame_size * uniforms[:2]
    growth = jnp.log(camera.outlier_size_max / camera.outlier_size_min)
    half = 0.5 * camera.outlier_size_min * jnp.exp(growth * uniforms[2:])
    return jnp.concatenate([center - half, center + half])


def target_pose_in_camera(
    camera: Camera, q_TN: Array, r_ST_N: Vector, q_BN: Array
) -> tuple[Float[Array, "3 3"], Vector]:
    """The target's axes `R_KT` and its place `r_TK_K` [m] in camera axes."""
    q_KN = camera_attitude(camera, q_BN)
    return quaternion.to_matrix(quaternion.multiply(q_KN, quaternion.conjugate(q_TN))), rotate(q_KN, -r_ST_N)


def hull_in_camera(hull_T: Float[Array, "n 3"], R_KT: Float[Array, "3 3"], r_TK_K: Vector) -> Float[Array, "n 3"]:
    """Hull vertices [m] in camera axes."""
    return jnp.sum(R_KT[None, :, :] * hull_T[:, None, :], axis=2) + r_TK_K[None, :]
