"""Pinhole camera with square pixels and a lens: intrinsics, projection of points, directions of pixels."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core import lens_distortion
from rpojax.core.pytree import pytree


@pytree
class Intrinsics:
    """Focal length, principal point and distortion.

    Attributes:
        focal_px: () focal length [px]
        center_px: (2,) principal point [px]
        distortion: (5,) coefficients of `lens_distortion`, None for a pinhole
    """

    focal_px: Array
    center_px: Array
    distortion: Array | None = None


def pinhole_intrinsics(
    field_of_view: Float[Array, ""], width_px: int, height_px: int, distortion: Float[Array, "5"] | None = None
) -> Intrinsics:
    """Intrinsics of a camera whose horizontal field of view [rad], without distortion, spans `width_px` pixels."""
    focal = 0.5 * width_px / jnp.tan(0.5 * field_of_view)
    center_px = jnp.array([0.5 * width_px, 0.5 * height_px], dtype=focal.dtype)
    return Intrinsics(focal_px=focal, center_px=center_px, distortion=distortion)


def project(intrinsics: Intrinsics, points_K: Float[Array, "n 3"]) -> Float[Array, "2 n"]:
    """Pixels (x right, y down) of points [m] in camera axes; meaningful only for points in front of the camera."""
    depth = jnp.where(points_K[:, 2] > 1e-6, points_K[:, 2], 1e-6)
    if intrinsics.distortion is not None:
        shown = lens_distortion.distort(intrinsics.distortion, points_K[:, 0] / depth, points_K[:, 1] / depth)
        return intrinsics.center_px[:, None] + intrinsics.focal_px * jnp.stack(shown)
    return jnp.stack(
        [
            intrinsics.center_px[0] + intrinsics.focal_px * points_K[:, 0] / depth,
            intrinsics.center_px[1] + intrinsics.focal_px * points_K[:, 1] / depth,
        ]
    )


def pixel_directions(size_px: int, field_of_view_deg: float) -> np.ndarray:
    """Unit vectors (p, p, 3) in camera axes through the pixel centres of a square frame."""
    place = (np.arange(size_px) + 0.5) / size_px * 2.0 - 1.0
    x, y = np.meshgrid(place, place)
    tangent = np.tan(np.radians(0.5 * field_of_view_deg))
    directions = np.stack([x * tangent, y * tangent, np.ones_like(x)], axis=2)
    return (directions / np.linalg.norm(directions, axis=2, keepdims=True)).astype(np.float32)
