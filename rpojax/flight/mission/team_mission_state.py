"""What the mission of a servicer in a team has beyond that of a servicer alone."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree, replace

Scalar = Float[Array, ""]


@pytree
class PhaseShift:
    """Angle by which a servicer's relative orbit is ahead of the plan; it goes to another one at a constant rate.

    Attributes:
        start: () at the latest decision [rad]
        begins_at: () time of that [s]
        wanted: () angle to which it goes [rad]
        present: (servicers,) bool, those that were in the team then, by what was known on board
    """

    start: Array
    begins_at: Array
    wanted: Array
    present: Array


@pytree
class TeamMission:
    """Record of the decisions that the other servicers brought about.

    Attributes:
        changed_at: () time of the latest burn decision that another servicer changed [s], minus infinity before
        changed_for: () int32, place in the team of that servicer, -1 before
        shift: of the relative orbit, None where it is that of the plan all the time
        rate: () at which the shift changes [rad/s]
    """

    changed_at: Array
    changed_for: Array
    shift: PhaseShift | None = None
    rate: Array | None = None


def initial(zero: Scalar, rate: Scalar | None = None, servicers: int = 1) -> TeamMission:
    """Before the first decision; the phases of so many servicers can shift if there is a `rate` for it [rad/s]."""
    team = TeamMission(changed_at=jnp.full_like(zero, -jnp.inf), changed_for=jnp.full((), -1, dtype=jnp.int32))
    if rate is None:
        return team
    none = 0.0 * zero
    shift = PhaseShift(start=none, begins_at=none, wanted=none, present=jnp.zeros(servicers, dtype=bool))
    return replace(team, shift=shift, rate=jnp.asarray(rate))


def angle(team: TeamMission, time: Scalar) -> Scalar:
    """Shift at a time [s] since the start, at or after the latest decision, or as it was then [rad]."""
    assert team.shift is not None
    assert team.rate is not None
    way = team.shift.wanted - team.shift.start
    reach = team.rate * jnp.maximum(time - team.shift.begins_at, 0.0)
    return team.shift.start + jnp.clip(way, -reach, reach)


def shifted(team: TeamMission, wanted: Scalar, present: Array, time: Scalar) -> TeamMission:
    """Record after the decision at `time` [s] that the shift goes to another angle [rad], with those `present`."""
    shift = PhaseShift(start=angle(team, time), begins_at=time, wanted=wanted, present=present)
    return replace(team, shift=shift)
