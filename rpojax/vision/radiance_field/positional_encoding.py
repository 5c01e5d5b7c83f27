"""Positional encoding of a point (Mildenhall et al., "NeRF", ECCV 2020, eq. 4)."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array


def positional_encoding(point: Array, frequencies: int) -> Array:
    """Sines and cosines (6 * frequencies,) of a point (3,) at doubling frequencies."""
    scale = jnp.asarray(np.pi * 2.0 ** np.arange(frequencies), jnp.float32)
    angles = (scale[:, None] * point[None, :]).reshape(-1)
    return jnp.concatenate([jnp.sin(angles), jnp.cos(angles)])
