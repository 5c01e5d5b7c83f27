"""Number of rays for rendering a target: side of the square of rays, and how many of them may hit the target."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.vision.pinhole import Intrinsics
from rpojax.vision.radiance_field.image_region import project_region, region_directions
from rpojax.vision.radiance_field.target_field import RadianceField, bounding_sphere, intersects

REGION_SIDES = (16, 32, 48, 64, 96, 128, 192, 256)
_SPARE = 1.17
"""Rays rendered by the largest number found."""
_PROBE_DIRECTIONS = 300
_PROBE_SIDE = 48

_bounding_sphere = jax.jit(bounding_sphere)


@dataclasses.dataclass(frozen=True)
class RaySampling:
    """How a target is sampled, static: a square of `side` x `side` rays, of which `ray_count` are rendered.

    Most of the square around a spacecraft is empty; an occupancy lookup finds the rays that may hit it.
    """

    side: int
    ray_count: int


def choose_ray_sampling(
    field: RadianceField, focal_px: float, min_range_m: float, oversampling: float = 1.5
) -> RaySampling:
    """Rays for images from a range [m] on, `oversampling` times as dense as the pixels there; chosen on the host.

    The number of rays is the largest of those that may hit the target from any of 300 directions, and a sixth more.
    """
    side = region_side(focal_px, float(_bounding_sphere(field)[1]), min_range_m, oversampling)
    fraction = np.max(_occupied_fractions(field, min_range_m))
    return RaySampling(side, min(side * side, 64 * int(np.ceil(_SPARE * fraction * side * side / 64))))


def region_side(focal_px: float, radius_m: float, min_range_m: float, oversampling: float) -> int:
    """Side of the square [rays] for a sphere of a radius [m] at a range [m]."""
    if min_range_m <= radius_m:
        return REGION_SIDES[-1]
    width = 2.0 * focal_px * radius_m / np.sqrt(min_range_m**2 - radius_m**2)
    return next((side for side in REGION_SIDES if side >= oversampling * width), REGION_SIDES[-1])


def _occupied_fractions(field: RadianceField, range_m: float) -> np.ndarray:
    """Fraction of the square's rays (300,) that may hit the target, from directions all round (Fibonacci lattice)."""
    center, radius = _bounding_sphere(field)
    distance = np.maximum(np.float32(range_m), np.float32(1.1) * np.asarray(radius))

    @jax.jit
    def occupied_fraction(field: RadianceField, away: Array, x: Array) -> Array:
        intrinsics = Intrinsics(focal_px=jnp.float32(1.0), center_px=jnp.zeros(2, jnp.float32))
        position, R_KT = center + distance * away, jnp.stack([x, jnp.cross(-away, x), -away])
        corner, side, _ = project_region(field, intrinsics, position, R_KT)
        rays = region_directions(intrinsics, _PROBE_SIDE, corner, side, R_KT)
        return jnp.mean(intersects(field, jnp.broadcast_to(position, rays.shape), rays).astype(jnp.float32))

    index = np.arange(_PROBE_DIRECTIONS) + 0.5
    height, azimuth = 1.0 - index / (0.5 * _PROBE_DIRECTIONS), np.pi * (1.0 + np.sqrt(5.0)) * index
    level = np.sqrt(1.0 - height**2)
    away = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), height], axis=1)
    x = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=1)
    pairs = zip(away.astype(np.float32), x.astype(np.float32), strict=True)
    return np.array([occupied_fraction(field, a, b) for a, b in pairs])
