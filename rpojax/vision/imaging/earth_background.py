"""Image of the Earth behind a target: ground, clouds, haze and the lit air above the limb."""

import jax.numpy as jnp
from jaxtyping import Array

from rpojax.vision.imaging.random_sky import Sky

_SCALE_HEIGHT = 0.003
_AIR_COLOR = (0.25, 0.45, 0.9)
_HAZE = 0.06
_DETAILS = ((36.0, 0.9), (288.0, 0.5))
"""Repetitions of the detail tile round the equator, and their amplitudes: 1100 and 140 km a tile."""


def render_earth(sky: Sky, rays_N: Array, position: Array, sun_N: Array, earth_rotation: Array) -> tuple[Array, Array]:
    """Radiance (h, w, 3) of the ground and of the air above the limb, and (h, w) 1 where a ray meets the ground.

    Lengths are in Earth radii; `earth_rotation` is the angle of Greenwich from the x axis of N [rad].
    """
    along = jnp.sum(rays_N * position[:, None, None], axis=0)
    square = jnp.sum(position * position)
    nearest = jnp.maximum(square - along * along, 0.0)
    hit = (nearest < 1.0) & (along < 0.0)
    distance = -along - jnp.sqrt(jnp.where(hit, 1.0 - nearest, 0.0))
    point = position[:, None, None] + distance[None] * rays_N
    lit = jnp.maximum(jnp.sum(point * sun_N[:, None, None], axis=0), 0.0)
    haze = _HAZE * jnp.asarray(_AIR_COLOR, jnp.float32)[None, None, :]
    ground = jnp.where(hit[:, :, None], (_surface(sky, point, hit, earth_rotation) + haze) * lit[:, :, None], 0.0)
    # Above the limb: air at the least height of the ray, as bright as the ground below it would be.
    height = jnp.sqrt(nearest) - 1.0
    foot = position[:, None, None] - along[None] * rays_N
    above = jnp.maximum(jnp.sum(foot * sun_N[:, None, None], axis=0), 0.0)
    glow = jnp.where((along < 0.0) & ~hit, above * jnp.exp(-jnp.maximum(height, 0.0) / _SCALE_HEIGHT), 0.0)
    air = 0.5 * glow[:, :, None] * jnp.asarray(_AIR_COLOR, jnp.float32)[None, None, :]
    return ground + air, hit.astype(jnp.float32)


def _surface(sky: Sky, point: Array, hit: Array, earth_rotation: Array) -> Array:
    """Linear colour (h, w, 3) of ground and clouds under full sunlight at points (3, h, w) of the unit sphere."""
    south = 0.5 - jnp.arcsin(jnp.clip(point[2], -1.0, 1.0)) / jnp.pi
    east = (jnp.arctan2(point[1], jnp.where(hit, point[0], 1.0)) - earth_rotation) / (2.0 * jnp.pi) + 0.5
    small = jnp.zeros_like(south)
    for times, strength in _DETAILS:
        # The pattern converges with the meridians at the poles.
        small = small + strength * _bilinear(sky.detail, 0.5 * south * times, east * times)
    # The textures end half a texel from the poles; unlike their columns, their rows are not periodic.
    clamped_south = jnp.clip(south, 0.5 / sky.cloud.shape[0], 1.0 - 0.5 / sky.cloud.shape[0])
    thickness = _bilinear(sky.cloud, clamped_south, east) + 0.6 * small
    cover = jnp.clip(thickness, 0.0, 1.0)[:, :, None]
    ground = _bilinear(sky.earth, clamped_south, east) * (1.0 + 0.15 * small)[:, :, None]
    return jnp.maximum(ground, 0.0) * (1.0 - cover) + (0.75 + 0.05 * small)[:, :, None] * cover


def _bilinear(texture: Array, down: Array, across: Array) -> Array:
    """Bilinear interpolation of a periodic texture (y, x, ...) at places (h, w), fractions of its height and width."""
    rows, columns = texture.shape[:2]
    y, x = down * rows - 0.5, across * columns - 0.5
    first_y, first_x = jnp.floor(y), jnp.floor(x)
    fraction_y, fraction_x = y - first_y, x - first_x
    total = jnp.zeros((), jnp.float32)
    for step_y in (0, 1):
        for step_x in (0, 1):
            weight = (fraction_y if step_y else 1.0 - fraction_y) * (fraction_x if step_x else 1.0 - fraction_x)
            row = jnp.mod(first_y.astype(jnp.int32) + step_y, rows)
            column = jnp.mod(first_x.astype(jnp.int32) + step_x, columns)
            total = total + weight.reshape(weight.shape + (1,) * (texture.ndim - 2)) * texture[row, column]
    return total
