"""Execution error of burns: covariance of magnitude and direction errors (Gates, 1963)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]


def burn_covariance(
    delta_v_N: Vector, burn_delta_v: Scalar, magnitude_sigma: Scalar, direction_sigma: Scalar
) -> Matrix:
    """Velocity covariance [m^2/s^2] of one step's part `delta_v_N` [m/s] of a burn of size `burn_delta_v` [m/s].

    A burn's execution error is drawn once for all of its steps. Each step gets its share of the burn's variance, so
    that the sum is right.
    """
    size = gradient_safe.norm(delta_v_N)
    along = gradient_safe.normalize(delta_v_N)
    projection = along[:, None] * along[None, :]
    across = jnp.eye(3, dtype=delta_v_N.dtype) - projection
    return size * burn_delta_v * (magnitude_sigma**2 * projection + direction_sigma**2 * across)
