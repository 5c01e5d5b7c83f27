"""Permission of burns after an abort: one, and another one only for a reason that was measured since.

An abort decides once about a burn, as soon as the thruster works: the smallest one whose free drift stays clear over
the horizon, or none. Without a measurement the estimate can only become less certain, which is no reason to burn
again. What is measured may be one: a burn that gave no thrust or was cut short, and a target in sight into whose
keep-out zone the drift leads by the estimate. The number of burns is limited all the same.
"""

import enum
from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]
Flag = Bool[Array, ""]

MOST_BURNS: Final = 3
"""Burns after an abort, at most [-]. A choice: one for each `AbortBurnReason`."""


class AbortBurnReason(enum.IntEnum):
    """Reason of a burn after an abort: the abort, a burn before it that was not made, or what was seen since."""

    NONE = 0
    ABORT = 1
    BURN_NOT_MADE = 2
    KEEP_OUT_SEEN = 3


@pytree
class AbortBurns:
    """Burns since an abort.

    Attributes:
        decided: () bool, whether the abort has decided about its burn
        count: () int32, of burns that were planned
        reason: () int32, an `AbortBurnReason`, of the latest one
    """

    decided: Array
    count: Array
    reason: Array


@pytree
class Permission:
    """Burns that may be made at a decision after an abort.

    Attributes:
        of_abort: () bool, whether the burn of the abort itself is due
        of_sight: () bool, whether one may be made because of what is seen
    """

    of_abort: Array
    of_sight: Array


def none() -> AbortBurns:
    """Before an abort."""
    zero = jnp.zeros((), dtype=jnp.int32)
    return AbortBurns(decided=jnp.zeros((), dtype=bool), count=zero, reason=zero)


def permission(burns: AbortBurns, has_aborted: Flag, thruster_works: Flag, sees: Flag, was_made: Flag) -> Permission:
    """Which burns may be made now; the target is known well by what the camera `sees`.

    `was_made` says that the latest planned burn gave its velocity change. One that was not is due again.
    """
    may = has_aborted & thruster_works & (burns.count < MOST_BURNS)
    due = ~burns.decided | _is_due_again(burns, was_made)
    return Permission(of_abort=may & due, of_sight=may & ~due & sees)


def recorded(burns: AbortBurns, allowed: Permission, is_planned: Flag, was_made: Flag) -> AbortBurns:
    """Record after a decision, at which a burn `is_planned` or not."""
    again = _is_due_again(burns, was_made)
    of_abort = jnp.where(burns.count > 0, int(AbortBurnReason.BURN_NOT_MADE), int(AbortBurnReason.ABORT))
    reason = jnp.where(allowed.of_abort, of_abort, int(AbortBurnReason.KEEP_OUT_SEEN))
    counts = is_planned & (allowed.of_abort | allowed.of_sight)
    return AbortBurns(
        decided=(burns.decided & ~again) | allowed.of_abort,
        count=burns.count + counts.astype(jnp.int32),
        reason=jnp.where(counts, reason, burns.reason).astype(jnp.int32),
    )


def is_made(delta_v_N: Float[Array, "3"], given: Scalar, is_over: Flag, has_failed: Flag) -> Flag:
    """Whether a burn was made: `given` is the velocity change of the time of its open valve [m/s].

    It `has_failed` if the chamber pressure showed no thrust. A burn of no size is made, and one that is not over yet
    counts as made.
    """
    size = gradient_safe.norm(delta_v_N)
    return (size <= 0.0) | ~is_over | (~has_failed & (given >= _MADE_SHARE * size))


def _is_due_again(burns: AbortBurns, was_made: Flag) -> Flag:
    return burns.decided & (burns.count > 0) & ~was_made


_MADE_SHARE = 0.5
"""Share of its velocity change from which a burn counts as made [-]. A choice: less is missing than was given."""
