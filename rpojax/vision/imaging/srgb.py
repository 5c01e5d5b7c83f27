"""The sRGB transfer function (IEC 61966-2-1), in JAX and in NumPy."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def linear_to_srgb(linear: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """sRGB codes of linear radiance, both in 0..1; values outside are clipped."""
    clipped = jnp.clip(linear, 0.0, 1.0)
    root = 1.055 * jnp.maximum(clipped, 0.0031308) ** (1.0 / 2.4) - 0.055
    return jnp.where(clipped <= 0.0031308, 12.92 * clipped, root)


def linear_to_srgb_numpy(linear: np.ndarray) -> np.ndarray:
    """The same in the precision of the input."""
    clipped = np.clip(linear, 0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * np.maximum(clipped, 1e-9) ** (1 / 2.4) - 0.055)
