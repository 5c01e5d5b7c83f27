"""The pinhole camera: pixels of points, and where a box points."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree


@pytree
class Intrinsics:
    """Pinhole geometry of a camera with square pixels.

    Attributes:
        focal_px: () focal length [px]
        center_px: (2,) principal point [px]
    """

    focal_px: Array
    center_px: Array


def pinhole_intrinsics(field_of_view: Float[Array, ""], width_px: int, height_px: int) -> Intrinsics:
    """Lens whose horizontal field of view [rad] spans `width_px` pixels."""
    focal = 0.5 * width_px / jnp.tan(0.5 * field_of_view)
    return Intrinsics(focal_px=focal, center_px=jnp.array([0.5 * width_px, 0.5 * height_px], dtype=jnp.float64))


def project(intrinsics: Intrinsics, points_K: Float[Array, "n 3"]) -> Float[Array, "2 n"]:
    """Pixels (x right, y down) of points [m] in camera axes; meaningful only for points in front of the camera."""
    depth = jnp.where(points_K[:, 2] > 1e-6, points_K[:, 2], 1e-6)
    return jnp.stack(
        [
            intrinsics.center_px[0] + intrinsics.focal_px * points_K[:, 0] / depth,
            intrinsics.center_px[1] + intrinsics.focal_px * points_K[:, 1] / depth,
        ]
    )


def normalized_coordinates(intrinsics: Intrinsics, pixel: Float[Array, "2"]) -> Float[Array, "2"]:
    """Tangents (x/z, y/z) of the ray through a pixel."""
    return (pixel - intrinsics.center_px) / intrinsics.focal_px
