"""Gravity gradient of a point-mass Earth; the acceleration itself is `zonal_gravity.gravity` of degree 0."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.constants import MU_EARTH

Vector = Float[Array, "3"]


def gravity_gradient(r_N: Vector) -> Float[Array, "3 3"]:
    """Derivative of two-body gravity with respect to position [1/s^2] (J2 changes it by a part in a thousand)."""
    square = jnp.sum(r_N * r_N, axis=0)
    inverse2 = 1.0 / square
    scale = MU_EARTH * inverse2 * jnp.sqrt(inverse2)
    identity = jnp.eye(3, dtype=r_N.dtype)
    return scale * (3.0 * inverse2 * r_N[:, None] * r_N[None, :] - identity)
