"""Generalised intersection over union (GIoU), which has a gradient also for disjoint boxes."""

import jax
import jax.numpy as jnp


def generalized_iou(a: jax.Array, b: jax.Array) -> jax.Array:
    """GIoU of boxes (..., 4) (Rezatofighi et al., CVPR 2019)."""
    low, high = jnp.maximum(a[..., :2], b[..., :2]), jnp.minimum(a[..., 2:], b[..., 2:])
    intersection = jnp.prod(jnp.maximum(high - low, 0.0), axis=-1)
    sides_a, sides_b = jnp.maximum(a[..., 2:] - a[..., :2], 0.0), b[..., 2:] - b[..., :2]
    union = jnp.prod(sides_a, axis=-1) + jnp.prod(sides_b, axis=-1) - intersection
    hull = jnp.maximum(a[..., 2:], b[..., 2:]) - jnp.minimum(a[..., :2], b[..., :2])
    hull_area = jnp.maximum(jnp.prod(hull, axis=-1), 1e-6)
    return intersection / jnp.maximum(union, 1e-6) - (hull_area - union) / hull_area
