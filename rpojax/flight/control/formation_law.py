"""Formation control law: velocity change from the predicted deviation of the relative state."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def lqr_feedback(gain: Float[Array, "3 6"], deviation: Float[Array, "6"]) -> Float[Array, "3"]:
    """Velocity change in H [m/s] by linear state feedback on the deviation of (rho, rho_dot) [m, m/s]."""
    return -jnp.sum(gain * deviation[None, :], axis=1)
