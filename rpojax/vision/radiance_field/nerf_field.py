"""Reference radiance field: a small NeRF (Mildenhall et al., ECCV 2020) that is also given the Sun, for comparison."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core.pytree import pytree
from rpojax.vision.multilayer_perceptron import Layers, apply_layers, initialize_layers
from rpojax.vision.radiance_field.deferred_shading import RADIANCE_GAMMA
from rpojax.vision.radiance_field.positional_encoding import positional_encoding
from rpojax.vision.radiance_field.ray_box_intersection import ray_box_intersection
from rpojax.vision.radiance_field.volume_rendering import RenderedRays

SAMPLES = 64
FREQUENCIES = 6


@pytree
class NerfField:
    """One network from a point, a view and a Sun to density and colour.

    Attributes:
        low: (3,) lowest corner of the target's box [m]
        high: (3,) highest corner [m]
        trunk: layers from the encoded point to density and a feature vector
        head: layers from feature vector, view, Sun and fill light to the colours under either
    """

    low: Array
    high: Array
    trunk: Layers
    head: Layers


def initialize_nerf(low: np.ndarray, high: np.ndarray, key: Array, width: int = 64) -> NerfField:
    """An untrained field for the box between two corners [m]."""
    inputs = 3 + 6 * FREQUENCIES
    return NerfField(
        low=jnp.asarray(low, jnp.float32),
        high=jnp.asarray(high, jnp.float32),
        trunk=initialize_layers(jax.random.fold_in(key, 1), (inputs, width, width, width, width, 1 + width)),
        head=initialize_layers(jax.random.fold_in(key, 2), (width + 9, 32, 6)),
    )


def nerf_density(field: NerfField, point: Array) -> Array:
    """Density [1/m] at a point (3,) [m]."""
    return _density_and_feature(field, point)[0]


def nerf_intersects(field: NerfField, origin: Array, direction: Array) -> Array:
    """Whether a ray crosses the box."""
    near, far = ray_box_intersection(field.low, field.high, origin, direction)
    return far > near


def _density_and_feature(field: NerfField, point: Array) -> tuple[Array, Array]:
    low, high = field.low, field.high
    size = jnp.max(high - low)
    place = (2.0 * point - low - high) / size
    values = apply_layers(field.trunk, jnp.concatenate([place, positional_encoding(place, FREQUENCIES)]))
    inside = jnp.all((point >= low) & (point <= high))
    return jnp.where(inside, jax.nn.softplus(values[0]) * (100.0 / size), 0.0), values[1:]


def render_nerf_ray(
    field: NerfField, origin: Array, direction: Array, sun: Array, fill: Array, shift: Array
) -> RenderedRays:
    """One ray rendered by quadrature at even distances; `shift` in -0.5 to 0.5 moves its samples."""
    near, far = ray_box_intersection(field.low, field.high, origin, direction)
    step = (far - near) / SAMPLES
    distance = near + step * (jnp.arange(SAMPLES, dtype=jnp.float32) + 0.5 + shift)
    sigma, feature = jax.vmap(lambda t: _density_and_feature(field, origin + t * direction))(distance)
    optical_depth = jnp.cumsum(sigma * step)
    weight = jnp.exp(sigma * step - optical_depth) * (1.0 - jnp.exp(-sigma * step))
    lights = jnp.concatenate([direction, sun, fill])
    head = jax.vmap(lambda f: apply_layers(field.head, jnp.concatenate([jax.nn.relu(f), lights])))(feature)
    color = jnp.sum(weight[:, None] * jax.nn.sigmoid(head) ** RADIANCE_GAMMA, axis=0)
    return RenderedRays(
        sunlit=color[:3],
        filled=color[3:],
        alpha=1.0 - jnp.exp(-optical_depth[-1]),
        depth=jnp.sum(weight * distance),
        normal=jnp.zeros((3,), jnp.float32),
    )
