"""What every field shares: rays, the box they cross, the weights of samples, and small networks."""

import itertools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core.pytree import pytree

Layers = tuple[tuple[Array, Array], ...]

TINY = 1e-6
GAMMA = 2.2
"""A network's output is close to a code value; radiance is its power."""


@pytree
class RenderedRays:
    """What rays bring back.

    Attributes:
        color: (n, 3) linear radiance, 1 = white level, times alpha
        alpha: (n,) share that the target covers
        depth: (n,) distance [m] times alpha
        normal: (n, 3) unit normal towards the viewer in T times alpha; zero for a field without one
    """

    color: Array
    alpha: Array
    depth: Array
    normal: Array


def ray_box_intersection(low: Array, high: Array, origin: Array, direction: Array) -> tuple[Array, Array]:
    """Distances at which a ray enters and leaves a box; equal where it misses."""
    safe_direction = jnp.where(jnp.abs(direction) < TINY, TINY, direction)
    first, second = (low - origin) / safe_direction, (high - origin) / safe_direction
    near = jnp.maximum(jnp.max(jnp.minimum(first, second)), 0.0)
    return near, jnp.maximum(jnp.min(jnp.maximum(first, second)), near)


def normalized(vector: Array) -> Array:
    """Unit vector; zero for a zero."""
    return vector * jax.lax.rsqrt(jnp.sum(vector * vector) + TINY)


def positional_encoding(point: Array, frequencies: int) -> Array:
    """Sines and cosines of a point (3,) at doubling frequencies."""
    scale = jnp.asarray(np.pi * 2.0 ** np.arange(frequencies), jnp.float32)
    angles = (scale[:, None] * point[None, :]).reshape(-1)
    return jnp.concatenate([jnp.sin(angles), jnp.cos(angles)])


def initialize_layers(key: Array, widths: Sequence[int]) -> Layers:
    """Fresh layers between widths (He et al., 2015)."""
    layers = []
    for index, (fan_in, fan_out) in enumerate(itertools.pairwise(widths)):
        scale = np.float32(np.sqrt(2.0 / fan_in))
        weight = scale * jax.random.normal(jax.random.fold_in(key, 100 + index), (fan_in, fan_out), jnp.float32)
        layers.append((weight, jnp.zeros((fan_out,), jnp.float32)))
    return tuple(layers)


def apply_layers(layers: Layers, inputs: Array) -> Array:
    """Output of layers with rectifiers between them."""
    values = inputs
    for index, (weight, bias) in enumerate(layers):
        values = values @ weight + bias
        if index < len(layers) - 1:
            values = jax.nn.relu(values)
    return values
