"""Straight line in the Hill frame, at a speed that falls with the remaining distance."""

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
class Approach:
    """Straight line from the position at the entry."""

    end_position: Array = number("where it ends, from the target, H", unit="m", length=3)
    max_speed: Array = number("speed far from the end", unit="m_s", above=0.0)
    time_constant: Array = number("remaining distance over the speed nearer to the end", unit="s", above=0.0)
    final_speed: Array = number("least speed on the way, at most the greatest", unit="m_s", above=0.0)


def state(reference: Approach, entry: PhaseEntry, orbit: TargetOrbit, elapsed: Scalar) -> Float[Array, "6"]:
    """Desired relative state in H [m, m/s] `elapsed` [s] after the entry, with the target's `orbit` then.

    The speed is constant, then falls exponentially, then is constant again; afterwards it stays at the end.
    """
    way = entry.relative_state[:3] - reference.end_position
    direction = gradient_safe.normalize(way)
    remaining, speed = _remaining_distance(reference, gradient_safe.norm(way), elapsed)
    moving = jnp.concatenate([reference.end_position + remaining * direction, -speed * direction])
    return from_entry(entry, elapsed, moving)


def end_position(reference: Approach, entry: PhaseEntry) -> Vector:
    """Position in H at which the servicer arrives [m]."""
    del entry
    return reference.end_position


def _durations(reference: Approach, distance: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Times at the highest speed, at a falling speed and at the final speed [s], from a distance to the end [m]."""
    fast, slow = reference.max_speed * reference.time_constant, reference.final_speed * reference.time_constant
    near = jnp.minimum(distance, fast)
    falling = reference.time_constant * jnp.log(jnp.maximum(near / slow, 1.0))
    return (distance - near) / reference.max_speed, falling, jnp.minimum(near, slow) / reference.final_speed


def _remaining_distance(reference: Approach, distance: Scalar, elapsed: Scalar) -> tuple[Scalar, Scalar]:
    """Remaining distance [m] and speed [m/s] at a time after the start at a distance from the end."""
    fast, falling, slow = _durations(reference, distance)
    near = jnp.minimum(distance, reference.max_speed * reference.time_constant)
    in_fast = jnp.clip(elapsed, 0.0, fast)
    in_falling = jnp.clip(elapsed - fast, 0.0, falling)
    in_slow = jnp.clip(elapsed - fast - falling, 0.0, slow)
    exponential = near * jnp.exp(-in_falling / reference.time_constant)
    remaining = reference.max_speed * (fast - in_fast) + exponential - reference.final_speed * in_slow
    speed = jnp.where(elapsed < fast + falling + slow, reference.final_speed, 0.0)
    speed = jnp.where(elapsed < fast + falling, exponential / reference.time_constant, speed)
    return jnp.maximum(remaining, 0.0), jnp.where(elapsed < fast, reference.max_speed, speed)
