"""Rotation of the Earth about its pole."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Scalar = Float[Array, ""]


def earth_rotation_angle(seconds: Scalar) -> Scalar:
    """Angle [rad] of Greenwich from the x axis of N, `seconds` after 2000-01-01 12:00 universal time.

    IERS Conventions 2010, equation 5.15.
    """
    days = seconds / 86400.0
    return 2.0 * jnp.pi * jnp.mod(0.7790572732640 + 0.00273781191135448 * days + jnp.mod(days, 1.0), 1.0)
