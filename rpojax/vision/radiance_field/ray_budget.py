"""The square of rays around a target, and how many of them are worth following."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.vision.pinhole import Intrinsics
from rpojax.vision.radiance_field.target_field import RadianceField, bounding_sphere, intersects

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]

REGION_SIDES = (16, 32, 48, 64, 96, 128, 192, 256)
_MARGIN = 1.03
_SPARE = 1.17
_LOOKS = 300
_PROBE_SIDE = 48


@dataclasses.dataclass(frozen=True)
class RaySampling:
    """How a target is sampled, static: a square of `side` x `side` rays, of which `rays` can be followed to an end.

    Most of the square around a spacecraft is empty. A lookup says which rays come near matter, and only those cost.
    """

    side: int
    ray_count: int

    @staticmethod
    def all_rays(side: int) -> "RaySampling":
        """Every ray of the square."""
        return RaySampling(side, side * side)


def choose_ray_sampling(
    field: RadianceField, focal_px: float, min_range_m: float, oversampling: float = 1.5
) -> RaySampling:
    """Rays that a segment of a run needs which comes no nearer than a least range [m]; chosen on the host.

    They are `oversampling` times as dense as the pixels at that range. The number to be followed is the most that any
    of 300 directions asks for, and a sixth more.
    """
    side = region_side(focal_px, float(bounding_sphere(field)[1]), min_range_m, oversampling)
    fraction = np.max(_occupied_fractions(field, min_range_m))
    return RaySampling(side, min(side * side, 64 * int(np.ceil(_SPARE * fraction * side * side / 64))))


def region_side(focal_px: float, radius_m: float, min_range_m: float, oversampling: float) -> int:
    """Side of the square [rays] for a ball of a radius [m] at a range [m]."""
    if min_range_m <= radius_m:
        return REGION_SIDES[-1]
    width = 2.0 * focal_px * radius_m / np.sqrt(min_range_m**2 - radius_m**2)
    return next((side for side in REGION_SIDES if side >= oversampling * width), REGION_SIDES[-1])


def _occupied_fractions(field: RadianceField, range_m: float) -> np.ndarray:
    """Share of the square's rays (300,) that come near matter, seen from all round."""
    middle, radius = bounding_sphere(field)
    intrinsics = Intrinsics(focal_px=jnp.float32(1.0), center_px=jnp.zeros(2, jnp.float32))
    distance = jnp.maximum(jnp.float32(range_m), 1.1 * radius)

    @jax.jit
    def occupied_fraction(field: RadianceField, away: Array, x: Array) -> Array:
        position, R_KT = middle + distance * away, jnp.stack([x, jnp.cross(-away, x), -away])
        corner, side, _ = project_region(field, intrinsics, position, R_KT)
        rays = region_directions(intrinsics, _PROBE_SIDE, corner, side, R_KT)
        return jnp.mean(intersects(field, jnp.broadcast_to(position, rays.shape), rays).astype(jnp.float32))

    index = np.arange(300) + 0.5
    height, azimuth = 1.0 - index / 150.0, np.pi * (1.0 + np.sqrt(5.0)) * index
    level = np.sqrt(1.0 - height**2)
    away = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), height], axis=1)
    x = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=1)
    pairs = zip(away.astype(np.float32), x.astype(np.float32), strict=True)
    return np.array([occupied_fraction(field, jnp.asarray(a), jnp.asarray(b)) for a, b in pairs])


def project_region(
    field: RadianceField, intrinsics: Intrinsics, r_KT_T: Array, R_KT: Array
) -> tuple[Array, Array, Array]:
    """Corner [px] and side [px] of the square around the projected ball, and whether the ball is in front."""
    middle, radius = bounding_sphere(field)
    center = jnp.sum(R_KT * (middle - r_KT_T)[None, :], axis=1)
    visible = center[2] > 1.01 * radius
    depth = jnp.where(visible, center[2], 2.0 * radius)
    focal = intrinsics.focal_px.astype(jnp.float32)
    # Edges of the ellipse to which a ball projects: its middle is not that of the ball where it is off the axis.
    rest = depth * depth - radius * radius
    place = center[:2] * depth / rest
    halves = radius * jnp.sqrt(center[:2] ** 2 + rest) / rest
    half = _MARGIN * focal * jnp.max(halves)
    pixel = intrinsics.center_px.astype(jnp.float32) + focal * place
    return jax.lax.stop_gradient((pixel - half, 2.0 * half, visible))


def region_directions(intrinsics: Intrinsics, count: int, corner: Array, side: Array, R_KT: Array) -> Array:
    """Unit vectors (count * count, 3) in T through the cells of the square."""
    place = (jnp.arange(count, dtype=jnp.float32) + 0.5) * (side / count)
    center, focal = intrinsics.center_px.astype(jnp.float32), intrinsics.focal_px.astype(jnp.float32)
    x = jnp.broadcast_to(((corner[0] + place - center[0]) / focal)[None, :], (count, count)).reshape(-1)
    y = jnp.broadcast_to(((corner[1] + place - center[1]) / focal)[:, None], (count, count)).reshape(-1)
    scale = jax.lax.rsqrt(1.0 + x * x + y * y)
    direction_K = jnp.stack([x * scale, y * scale, scale], axis=1)
    return jnp.sum(direction_K[:, :, None] * R_KT[None, :, :], axis=1)
