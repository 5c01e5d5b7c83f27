"""Intersection of a ray with an axis-aligned box (slab method)."""

import jax.numpy as jnp
from jaxtyping import Array

_MIN_SLOPE = 1e-6


def ray_box_intersection(low: Array, high: Array, origin: Array, direction: Array) -> tuple[Array, Array]:
    """Distances at which a ray enters and leaves a box; equal where it misses."""
    safe_direction = jnp.where(jnp.abs(direction) < _MIN_SLOPE, _MIN_SLOPE, direction)
    first, second = (low - origin) / safe_direction, (high - origin) / safe_direction
    near = jnp.maximum(jnp.max(jnp.minimum(first, second)), 0.0)
    return near, jnp.maximum(jnp.min(jnp.maximum(first, second)), near)
