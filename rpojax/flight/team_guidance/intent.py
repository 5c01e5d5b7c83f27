"""What a servicer tells the others of its plans: a burn that it has decided, and whether it keeps its place."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.pytree import pytree
from rpojax.flight.guidance.burn_schedule import BurnPlan

Scalar = Float[Array, ""]


@pytree
class Intent:
    """Plans of a servicer at a time stamp.

    Attributes:
        time: () time stamp since the start [s], minus infinity before the first one
        follows: () bool, whether it follows the reference of its phase; after an abort it does not
        delta_v_N: (3,) what is left of a burn that it has decided [m/s]
        burn_time: () middle of that [s]
        shift: () angle by which its relative orbit is, or is to be, ahead of the plan [rad]
        sees: () bool, whether it has a box of the target
    """

    time: Array
    follows: Array
    delta_v_N: Array
    burn_time: Array
    shift: Array
    sees: Array


def intent(plan: BurnPlan, follows: Bool[Array, ""], shift: Scalar, sees: Bool[Array, ""], time: Scalar) -> Intent:
    """Plans of a servicer at `time` [s], with the shift of its relative orbit [rad] and whether it has a box."""
    begin = jnp.maximum(plan.ignition, time)
    duration = plan.cutoff - plan.ignition
    left = jnp.clip((plan.cutoff - begin) / jnp.where(duration > 0.0, duration, 1.0), 0.0, 1.0)
    return Intent(
        time=time,
        follows=follows,
        delta_v_N=jnp.where(duration > 0.0, left, 0.0) * plan.delta_v_N,
        burn_time=0.5 * (begin + jnp.maximum(plan.cutoff, begin)),
        shift=shift,
        sees=sees,
    )


def before_the_first(time: Scalar) -> Intent:
    """What is assumed of a servicer at the start, at `time` [s]: it follows its phase, and has decided no burn."""
    yes, zero = jnp.ones((), dtype=bool), jnp.zeros_like(time)
    return Intent(time=time, follows=yes, delta_v_N=jnp.stack([zero] * 3), burn_time=time, shift=zero, sees=~yes)
