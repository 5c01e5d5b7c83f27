"""Free motion of one spacecraft relative to another over some seconds, in inertial axes.

The gravity gradient is constant meanwhile; the series in time has an error of the fourth order in orbit angle, 1e-7 of
the motion over 20 s in a low orbit.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]


def transition_matrix(gravity_gradient: Matrix, t: Scalar | float) -> Float[Array, "6 6"]:
    """State transition matrix of position and velocity over `t` [s], which may be negative."""
    identity = jnp.eye(3, dtype=gravity_gradient.dtype)
    same = identity + (0.5 * t * t) * gravity_gradient
    drift = t * identity + (t * t * t / 6.0) * gravity_gradient
    return jnp.concatenate(
        [jnp.concatenate([same, drift], axis=1), jnp.concatenate([t * gravity_gradient, same], axis=1)], axis=0
    )


def apply(A: Float[Array, "m n"], x: Float[Array, " n"]) -> Float[Array, " m"]:
    """Product of a matrix and a vector."""
    return jnp.sum(A * x[None, :], axis=1)
