"""Background of an image: stars and the Earth for a camera's position and attitude."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import lens_distortion
from rpojax.vision.imaging.earth_background import render_earth
from rpojax.vision.imaging.random_sky import Sky
from rpojax.vision.imaging.star_field import render_stars
from rpojax.vision.pinhole import Intrinsics

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Image = Float[Array, "h w 3"]


def background(
    sky: Sky,
    intrinsics: Intrinsics,
    width_px: int,
    height_px: int,
    R_KN: Matrix,
    position: Vector,
    sun_N: Vector,
    earth_rotation: Array,
    binning: Array | float = 1.0,
) -> Image:
    """Linear image (h, w, 3) of stars and Earth; all arrays float32.

    `position` is the camera from the Earth's centre in Earth radii and N components, `sun_N` a unit vector,
    `earth_rotation` the angle [rad] of Greenwich from the x axis of N. A pixel of the image is the mean of
    `binning` x `binning` pixels of the sensor, of which a star lights one.
    """
    center, focal = intrinsics.center_px.astype(jnp.float32), intrinsics.focal_px.astype(jnp.float32)
    x = (jnp.arange(width_px, dtype=jnp.float32) + 0.5 - center[0]) / focal
    y = (jnp.arange(height_px, dtype=jnp.float32) + 0.5 - center[1]) / focal
    shape = (height_px, width_px)
    plane = jnp.broadcast_to(x[None, :], shape), jnp.broadcast_to(y[:, None], shape)
    rays_K = jnp.stack([*lens_distortion.undistort(intrinsics.distortion, *plane), jnp.ones(shape, jnp.float32)])
    rays_K = rays_K * jax.lax.rsqrt(jnp.sum(rays_K * rays_K, axis=0))[None]
    rays_N = jnp.einsum("ki,khw->ihw", R_KN, rays_K)
    earth, covered = render_earth(sky, rays_N, position, sun_N, earth_rotation)
    stars = render_stars(sky, intrinsics, shape, R_KN)
    return earth + (stars / (binning * binning))[:, :, None] * (1.0 - covered)[:, :, None]
