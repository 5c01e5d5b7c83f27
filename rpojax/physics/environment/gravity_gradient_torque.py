"""Gravity-gradient torque on a rigid body."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.constants import MU_EARTH
from rpojax.core.vectors import apply, cross

Vector = Float[Array, "3"]
Scalar = Float[Array, ""]


def gravity_gradient_torque(r_B: Vector, inertia: Float[Array, "3 3"], mu: Scalar | float = MU_EARTH) -> Vector:
    """Torque [N m] of two-body gravity on a body with inertia [kg m^2] at position `r_B` [m], body axes.

    Schaub and Junkins, Analytical Mechanics of Space Systems, section 4.5.
    """
    square = jnp.sum(r_B * r_B, axis=0)
    scale = 3.0 * mu / (square * square * jnp.sqrt(square))
    return scale * cross(r_B, apply(inertia, r_B))
