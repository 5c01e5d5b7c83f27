"""Straight line away from the target."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.declared_numbers import number
from rpojax.core.numerics import gradient_safe
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import pytree
from rpojax.flight.guidance.references.phase_entry import PhaseEntry, from_entry

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class Retreat:
    """Straight line away from the target, through the position at the entry."""

    distance: Array = number("distance from the target at which it ends; a servicer beyond stays", unit="m", above=0.0)
    speed: Array = number("speed that is reached after some seconds", unit="m_s", above=0.0)


def state(reference: Retreat, entry: PhaseEntry, orbit: TargetOrbit, elapsed: Scalar) -> Float[Array, "6"]:
    """Desired relative state in H [m, m/s] `elapsed` [s] after the entry, with the target's `orbit` then.

    The speed rises exponentially; the servicer stops at the end.
    """
    start = entry.relative_state[:3]
    direction = gradient_safe.normalize(start)
    length = gradient_safe.norm(end_position(reference, entry) - start)
    rise = _RISE_SHARE * length / reference.speed
    moves = rise > 0.0
    time, rise = jnp.maximum(elapsed, 0.0), jnp.where(moves, rise, 1.0)
    missing = jnp.exp(-time / rise)
    covered = reference.speed * (time - rise * (1.0 - missing))
    on_way = moves & (covered < length)
    speed = jnp.where(on_way, reference.speed * (1.0 - missing), 0.0)
    moving = jnp.concatenate([start + jnp.minimum(covered, length) * direction, speed * direction])
    return from_entry(entry, elapsed, moving)


def end_position(reference: Retreat, entry: PhaseEntry) -> Vector:
    """Position in H at which the servicer arrives [m]."""
    start = entry.relative_state[:3]
    return jnp.maximum(reference.distance, gradient_safe.norm(start)) * gradient_safe.normalize(start)


_RISE_SHARE = 0.05
"""Time constant of the rising speed over the time of the whole way at full speed [-]: 95 % of the speed after 15 % of
that time, which are three time constants."""
