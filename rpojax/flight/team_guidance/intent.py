"""What a servicer tells the others of its plans: a burn that it has decided, and whether it keeps its place."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.pytree import pytree, replace
from rpojax.flight.guidance.burn_planning import BurnPlan

Scalar = Float[Array, ""]


@pytree
class Intent:
    """Plans of a servicer at a time stamp.

    Attributes:
        time: () time stamp since the start [s], minus infinity before the first one
        follows: () bool, whether it follows the reference of its phase; after an abort it does not
        delta_v_N: (3,) what is left of a burn that it has decided [m/s]
        burn_time: () middle of that [s]
    """

    time: Array
    follows: Array
    delta_v_N: Array
    burn_time: Array


def intent(plan: BurnPlan, follows: Bool[Array, ""], time: Scalar) -> Intent:
    """Plans of a servicer at `time` [s]."""
    begin = jnp.maximum(plan.ignition, time)
    duration = plan.cutoff - plan.ignition
    left = jnp.clip((plan.cutoff - begin) / jnp.where(duration > 0.0, duration, 1.0), 0.0, 1.0)
    return Intent(
        time=time,
        follows=follows,
        delta_v_N=jnp.where(duration > 0.0, left, 0.0) * plan.delta_v_N,
        burn_time=0.5 * (begin + jnp.maximum(plan.cutoff, begin)),
    )


def before_the_first(time: Scalar) -> Intent:
    """What is assumed of a servicer at the start, at `time` [s]: it follows its phase, and has decided no burn."""
    yes = jnp.ones((), dtype=bool)
    return Intent(time=time, follows=yes, delta_v_N=jnp.stack([jnp.zeros_like(time)] * 3), burn_time=time)


def delay_line(first: Intent, delay_ticks: int) -> Intent:
    """Messages of the last ticks, newest first along a leading axis; none of them has been sent."""
    line = jax.tree.map(lambda leaf: jnp.stack([leaf] * (delay_ticks + 1)), first)
    return replace(line, time=jnp.full_like(line.time, -jnp.inf))


def push(line: Intent, new: Intent) -> Intent:
    """Delay line one tick later, with a new message."""
    return jax.tree.map(lambda old, one: jnp.concatenate([one[None], old[:-1]]), line, new)


def oldest(line: Intent) -> Intent:
    """The message that arrives now."""
    return jax.tree.map(lambda leaf: leaf[-1], line)
