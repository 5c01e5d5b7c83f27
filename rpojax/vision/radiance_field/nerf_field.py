"""The reference field: the classic network of Mildenhall et al., "NeRF", ECCV 2020, at small size, for comparison."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core.pytree import pytree
from rpojax.vision.radiance_field.volume_rendering import (
    GAMMA,
    Layers,
    Rays,
    apply_layers,
    crossing,
    encode_point,
    new_layers,
)

SAMPLES = 64
FREQUENCIES = 6


@pytree
class PointField:
    """One network from a point, a view and a Sun to density and colour.

    Attributes:
        low: (3,) lowest corner of the target's box [m]
        high: (3,) highest corner [m]
        trunk: layers from the encoded point to density and a feature vector
        head: layers from feature vector, view and Sun to colour
    """

    low: Array
    high: Array
    trunk: Layers
    head: Layers


def new_point(low: np.ndarray, high: np.ndarray, key: Array, width: int = 64) -> PointField:
    """A fresh reference field for the box between two corners [m]."""
    inputs = 3 + 6 * FREQUENCIES
    return PointField(
        low=jnp.asarray(low, jnp.float32),
        high=jnp.asarray(high, jnp.float32),
        trunk=new_layers(jax.random.fold_in(key, 1), (inputs, width, width, width, width, 1 + width)),
        head=new_layers(jax.random.fold_in(key, 2), (width + 6, 32, 3)),
    )


def point_density(field: PointField, point: Array) -> Array:
    """Density [1/m] at a point (3,) [m]."""
    return _trunk(field, point)[0]


def point_touches(field: PointField, origin: Array, direction: Array) -> Array:
    """Whether a ray crosses the box."""
    near, far = crossing(field.low, field.high, origin, direction)
    return far > near


def _trunk(field: PointField, point: Array) -> tuple[Array, Array]:
    low, high = field.low, field.high
    size = jnp.max(high - low)
    place = (2.0 * point - low - high) / size
    values = apply_layers(field.trunk, jnp.concatenate([place, encode_point(place, FREQUENCIES)]))
    inside = jnp.all((point >= low) & (point <= high))
    return jnp.where(inside, jax.nn.softplus(values[0]) * (100.0 / size), 0.0), values[1:]


def point_ray(field: PointField, origin: Array, direction: Array, sun: Array, shift: Array) -> Rays:
    """What one ray brings back; `shift` in -0.5 to 0.5 moves its samples."""
    near, far = crossing(field.low, field.high, origin, direction)
    step = (far - near) / SAMPLES
    distance = near + step * (jnp.arange(SAMPLES, dtype=jnp.float32) + 0.5 + shift)
    sigma, feature = jax.vmap(lambda t: _trunk(field, origin + t * direction))(distance)
    passed = jnp.cumsum(sigma * step)
    weight = jnp.exp(sigma * step - passed) * (1.0 - jnp.exp(-sigma * step))
    head = jax.vmap(lambda f: apply_layers(field.head, jnp.concatenate([jax.nn.relu(f), direction, sun])))(feature)
    color = jnp.sum(weight[:, None] * jax.nn.sigmoid(head) ** GAMMA, axis=0)
    return Rays(
        color=color,
        alpha=1.0 - jnp.exp(-passed[-1]),
        depth=jnp.sum(weight * distance),
        normal=jnp.zeros((3,), jnp.float32),
    )
