"""Image of the star field for a camera's attitude."""

import jax.numpy as jnp
from jaxtyping import Array

from rpojax.core import lens_distortion
from rpojax.vision.imaging.random_sky import Sky
from rpojax.vision.pinhole import Intrinsics


def render_stars(sky: Sky, intrinsics: Intrinsics, shape: tuple[int, int], R_KN: Array) -> Array:
    """Radiance (h, w) of stars, each shared by the four pixels around it."""
    star_K = jnp.einsum("ki,ni->nk", R_KN, sky.star_N)
    ahead = star_K[:, 2] > 0.1
    depth = jnp.where(ahead, star_K[:, 2], 1.0)
    center, focal = intrinsics.center_px.astype(jnp.float32), intrinsics.focal_px.astype(jnp.float32)
    tangents = lens_distortion.distort(intrinsics.distortion, star_K[:, 0] / depth, star_K[:, 1] / depth)
    place = center[None, :] + focal * jnp.stack(tangents, axis=1) - 0.5
    first = jnp.floor(place)
    fraction = place - first
    column, row = first[:, 0].astype(jnp.int32), first[:, 1].astype(jnp.int32)
    radiance = jnp.where(ahead, sky.star_radiance, 0.0)
    image = jnp.zeros(shape, jnp.float32)
    for dy in (0, 1):
        for dx in (0, 1):
            part = (fraction[:, 0] if dx else 1.0 - fraction[:, 0]) * (fraction[:, 1] if dy else 1.0 - fraction[:, 1])
            inside = (column + dx >= 0) & (column + dx < shape[1]) & (row + dy >= 0) & (row + dy < shape[0])
            rows, columns = jnp.where(inside, row + dy, 0), jnp.where(inside, column + dx, 0)
            image = image.at[rows, columns].add(jnp.where(inside, radiance * part, 0.0))
    return image
