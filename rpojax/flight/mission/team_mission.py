"""What the mission of a servicer in a team has beyond that of a servicer alone."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree


@pytree
class TeamMission:
    """Record of the decisions that the other servicers brought about.

    Attributes:
        changed_at: () time of the latest burn decision that another servicer changed [s], minus infinity before
        changed_for: () int32, place in the team of that servicer, -1 before
    """

    changed_at: Array
    changed_for: Array


def initial(zero: Float[Array, ""]) -> TeamMission:
    """Before the first decision."""
    return TeamMission(changed_at=jnp.full_like(zero, -jnp.inf), changed_for=jnp.full((), -1, dtype=jnp.int32))
