"""A measure of how well boxes agree that has a slope even where they are apart."""

import jax
import jax.numpy as jnp


def giou(a: jax.Array, b: jax.Array) -> jax.Array:
    """Generalised intersection over union of boxes (..., 4) (Rezatofighi et al., CVPR 2019)."""
    low, high = jnp.maximum(a[..., :2], b[..., :2]), jnp.minimum(a[..., 2:], b[..., 2:])
    both = jnp.prod(jnp.maximum(high - low, 0.0), axis=-1)
    sides_a, sides_b = jnp.maximum(a[..., 2:] - a[..., :2], 0.0), b[..., 2:] - b[..., :2]
    either = jnp.prod(sides_a, axis=-1) + jnp.prod(sides_b, axis=-1) - both
    hull = jnp.maximum(a[..., 2:], b[..., 2:]) - jnp.minimum(a[..., :2], b[..., :2])
    around = jnp.maximum(jnp.prod(hull, axis=-1), 1e-6)
    return both / jnp.maximum(either, 1e-6) - (around - either) / around
