"""What surrounds the vehicles: sunlight and the torque of the gravity gradient."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.constants import MU_EARTH, RADIUS_EARTH
from rpojax.core.frames import apply
from rpojax.core.pytree import pytree
from rpojax.core.quaternion import cross

Vector = Float[Array, "3"]


@pytree
class Sun:
    """Sunlight.

    Attributes:
        direction: (3,) towards the Sun in N, fixed over the run; any length
    """

    direction: Array


def is_lit(r_N: Vector, sun_N: Vector) -> Bool[Array, ""]:
    """True outside the Earth's shadow, taken as a cylinder behind the Earth; `sun_N` is the unit vector to the Sun."""
    along = jnp.sum(r_N * sun_N, axis=0)
    across = r_N - along * sun_N
    return (along > 0.0) | (jnp.sum(across * across, axis=0) > RADIUS_EARTH**2)


def gravity_gradient_torque(r_B: Vector, inertia: Float[Array, "3 3"]) -> Vector:
    """Torque [N m] of two-body gravity on a body with the given inertia [kg m^2] at position `r_B` [m], body axes.

    Schaub and Junkins, Analytical Mechanics of Space Systems, section 4.5.
    """
    square = jnp.sum(r_B * r_B, axis=0)
    scale = 3.0 * MU_EARTH / (square * square * jnp.sqrt(square))
    return scale * cross(r_B, apply(inertia, r_B))
