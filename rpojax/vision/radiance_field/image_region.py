"""Square region of the image around a target's bounding sphere, and the rays through it."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core import lens_distortion
from rpojax.vision.pinhole import Intrinsics
from rpojax.vision.radiance_field.target_field import RadianceField, bounding_sphere

_MARGIN = 1.03
"""Side of the region by that of the sphere's image."""
_EDGE_PLACES = 9


def project_region(
    field: RadianceField, intrinsics: Intrinsics, r_KT_T: Array, R_KT: Array
) -> tuple[Array, Array, Array]:
    """Corner [px] and side [px] of the square around the projected sphere, and whether the sphere is in front."""
    sphere_center, radius = bounding_sphere(field)
    center = jnp.sum(R_KT * (sphere_center - r_KT_T)[None, :], axis=1)
    visible = center[2] > 1.01 * radius
    depth = jnp.where(visible, center[2], 2.0 * radius)
    focal = intrinsics.focal_px.astype(jnp.float32)
    # Edges of the ellipse to which a sphere projects; off the axis its centre is not the image of the sphere's centre.
    rest = depth * depth - radius * radius
    place = center[:2] * depth / rest
    half_sides = radius * jnp.sqrt(center[:2] ** 2 + rest) / rest
    if intrinsics.distortion is not None:
        place, half_sides = _shown_square(intrinsics, place, half_sides)
    half = _MARGIN * focal * jnp.max(half_sides)
    pixel = intrinsics.center_px.astype(jnp.float32) + focal * place
    return jax.lax.stop_gradient((pixel - half, 2.0 * half, visible))


def _shown_square(intrinsics: Intrinsics, place: Array, half_sides: Array) -> tuple[Array, Array]:
    """Middle and half sides of the box around a box of tangents as the lens shows it, by places along its edges."""
    steps, ones = np.linspace(-1.0, 1.0, _EDGE_PLACES, dtype=np.float32), np.ones(_EDGE_PLACES, np.float32)
    along, across = np.concatenate([steps, steps, -ones, ones]), np.concatenate([-ones, ones, steps, steps])
    edge = place[:, None] + half_sides[:, None] * np.stack([along, across])
    shown = jnp.stack(lens_distortion.distort(intrinsics.distortion, edge[0], edge[1]))
    low, high = jnp.min(shown, axis=1), jnp.max(shown, axis=1)
    return 0.5 * (low + high), 0.5 * (high - low)


def region_directions(intrinsics: Intrinsics, count: int, corner: Array, side: Array, R_KT: Array) -> Array:
    """Unit vectors (count * count, 3) in T through the cells of the square."""
    place = (jnp.arange(count, dtype=jnp.float32) + 0.5) * (side / count)
    center, focal = intrinsics.center_px.astype(jnp.float32), intrinsics.focal_px.astype(jnp.float32)
    x = jnp.broadcast_to(((corner[0] + place - center[0]) / focal)[None, :], (count, count)).reshape(-1)
    y = jnp.broadcast_to(((corner[1] + place - center[1]) / focal)[:, None], (count, count)).reshape(-1)
    x, y = lens_distortion.undistort(intrinsics.distortion, x, y)
    scale = jax.lax.rsqrt(1.0 + x * x + y * y)
    direction_K = jnp.stack([x * scale, y * scale, scale], axis=1)
    return jnp.sum(direction_K[:, :, None] * R_KT[None, :, :], axis=1)
