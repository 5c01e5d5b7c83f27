"""Geometric camera model: the target's hull through a pinhole, with the errors of a detector."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.sensors.camera import NEAREST_DEPTH, Camera, CameraFrame
from rpojax.vision import bounding_box, box_projection
from rpojax.vision.bounding_box import BoundingBox


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
    """Frame of one exposure of the hull vertices `hull_K` [m] in camera axes; there is no box without light.

    `observable` is the light, `working` the camera's health.
    """
    intrinsics = camera.lens(width_px, height_px)
    true_edges = box_projection.projected_box(intrinsics, hull_K)
    in_front = jnp.min(hull_K[:, 2], axis=0) > NEAREST_DEPTH
    center = bounding_box.box_center(true_edges)
    frame_size = jnp.array([width_px, height_px], dtype=hull_K.dtype)
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
        observable=observable,
        score=jnp.where(box.present, 1.0, 0.0),
        window=jnp.array([0.0, 0.0, max(width_px, height_px)], dtype=hull_K.dtype),
        outlier=outlier,
        outline=visible,
    )


def _false_box(camera: Camera, frame_size: Float[Array, "2"], uniforms: Float[Array, "4"]) -> Float[Array, "4"]:
    """False box: centre uniform over the frame, sides log-uniform."""
    center = frame_size * uniforms[:2]
    growth = jnp.log(camera.outlier_size_max / camera.outlier_size_min)
    half = 0.5 * camera.outlier_size_min * jnp.exp(growth * uniforms[2:])
    return jnp.concatenate([center - half, center + half])
