"""Formation control law: velocity change from the predicted deviation of the relative state."""

from typing import Protocol, runtime_checkable

import jax.numpy as jnp
from jaxtyping import Array, Float

Vector = Float[Array, "3"]


@runtime_checkable
class FormationLaw(Protocol):
    """Signature of a formation controller that can replace `lqr_feedback`."""

    def __call__(self, gain: Float[Array, "3 6"], deviation: Float[Array, "6"]) -> Vector:
        """Velocity change in H [m/s] for the predicted deviation of (rho, rho_dot) at the burn [m, m/s]."""
        ...


def lqr_feedback(gain: Float[Array, "3 6"], deviation: Float[Array, "6"]) -> Vector:
    """Velocity change in H [m/s] by linear state feedback."""
    return -jnp.sum(gain * deviation[None, :], axis=1)
