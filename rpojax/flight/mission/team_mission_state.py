"""Additional mission state of a servicer that belongs to a team."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree, replace

Scalar = Float[Array, ""]


@pytree
class PhaseShift:
    """Angle by which a servicer's relative orbit is ahead of the plan; it moves to a new angle at a constant rate.

    Attributes:
        start: () at the latest decision [rad]
        begins_at: () time of that decision [s]
        wanted: () angle to which it moves [rad]
        present: (servicers,) bool, servicers that were in the team at that time, as far as known on board
    """

    start: Array
    begins_at: Array
    wanted: Array
    present: Array


@pytree
class TeamMission:
    """Record of the decisions that other servicers changed.

    Attributes:
        changed_at: () time of the latest burn decision that another servicer changed [s], minus infinity before
        changed_for: () int32, place in the team of that servicer, -1 before
        shift: of the relative orbit, None if it always follows the plan
        rate: () at which the shift changes [rad/s]
    """

    changed_at: Array
    changed_for: Array
    shift: PhaseShift | None = None
    rate: Array | None = None


def initial(zero: Scalar, rate: Scalar | None = None, servicers: int = 1) -> TeamMission:
    """State before the first decision; with a `rate` [rad/s] the relative orbits of a team of `servicers` can shift."""
    team = TeamMission(changed_at=jnp.full_like(zero, -jnp.inf), changed_for=jnp.full((), -1, dtype=jnp.int32))
    if rate is None:
        return team
    none = 0.0 * zero
    shift = PhaseShift(start=none, begins_at=none, wanted=none, present=jnp.zeros(servicers, dtype=bool))
    return replace(team, shift=shift, rate=jnp.asarray(rate))


def angle(team: TeamMission, time: Scalar) -> Scalar:
    """Shift [rad] at `time` [s] since the start; before the latest decision, the shift at that decision."""
    assert team.shift is not None
    assert team.rate is not None
    way = team.shift.wanted - team.shift.start
    reach = team.rate * jnp.maximum(time - team.shift.begins_at, 0.0)
    return team.shift.start + jnp.clip(way, -reach, reach)


def shifted(team: TeamMission, wanted: Scalar, present: Array, time: Scalar) -> TeamMission:
    """Record after the decision at `time` [s] that the shift goes to another angle [rad], with those `present`."""
    shift = PhaseShift(start=angle(team, time), begins_at=time, wanted=wanted, present=present)
    return replace(team, shift=shift)
