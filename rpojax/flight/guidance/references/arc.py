"""Arc about the target to a place, where the servicer then stays: no nearer on the way than at its ends."""

from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.declared_numbers import number
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import arctan2, cos_sin
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import pytree
from rpojax.core.vectors import cross
from rpojax.flight.guidance.references.phase_entry import PhaseEntry, from_entry, smooth_step

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class Arc:
    """Arc from the position at the entry, over the shorter angle."""

    position: Array = number("where it ends, from the target, in the axes of the phase's frame", unit="m", length=3)
    duration: Array = number("time until it is there", unit="s", above=0.0)


def state(reference: Arc, entry: PhaseEntry, orbit: TargetOrbit, elapsed: Scalar) -> Float[Array, "6"]:
    """Desired relative state [m, m/s] `elapsed` [s] after the entry, with the target's `orbit` then.

    Direction and distance go over smoothly. What the servicer turns about the target at its entry, as one at rest does
    about a tumbling target in whose frame the arc is, is slowed down at the same distance: so the arc begins with its
    velocity across the line to the target.
    """
    del orbit
    start, velocity = entry.relative_state[:3], entry.relative_state[3:]
    first, last = gradient_safe.norm(start), gradient_safe.norm(reference.position)
    begin, end = gradient_safe.normalize(start), gradient_safe.normalize(reference.position)
    normal, sine = _normal(begin, end)
    angle = arctan2(sine, jnp.sum(begin * end, axis=0))
    share, slope, _ = smooth_step(elapsed, reference.duration)
    c, s = cos_sin(share * angle)
    on_arc, ahead = c * begin + s * cross(normal, begin), c * cross(normal, begin) - s * begin
    # What it turns by at the entry, about a fixed axis.
    spin = cross(begin, velocity) / jnp.maximum(first, _LEAST_DISTANCE)
    rate = gradient_safe.norm(spin)
    axis = gradient_safe.normalize(spin)
    turned, turning = _slowed(elapsed, reference.duration)
    c, s = cos_sin(rate * turned)
    direction = _rotated(axis, c, s, on_arc)
    change = _rotated(axis, c, s, slope * angle * ahead) + turning * cross(spin, direction)
    distance, growth = first + share * (last - first), slope * (last - first)
    moving = jnp.concatenate([distance * direction, growth * direction + distance * change])
    return from_entry(entry, elapsed, moving)


def end_position(reference: Arc, entry: PhaseEntry) -> Vector:
    """Position at which the servicer arrives [m]."""
    del entry
    return reference.position


def _slowed(elapsed: Scalar, duration: Scalar) -> tuple[Scalar, Scalar]:
    """Time for which a rate acts that falls to 0 in a duration [s], where all that it turned is undone; its slope."""
    place = jnp.clip(elapsed / duration, 0.0, 1.0)
    rest = 1.0 - place
    return place * rest**3 * duration, rest**2 * (1.0 - 4.0 * place)


def _normal(begin: Vector, end: Vector) -> tuple[Vector, Scalar]:
    """Normal of the plane of an arc, and the sine of its angle; of opposite directions, any normal across them."""
    normal = cross(begin, end)
    sine = gradient_safe.norm(normal)
    x, y, _ = begin
    zero, one = jnp.zeros_like(x), jnp.ones_like(x)
    other = jnp.where(jnp.abs(y) < _ALONG, jnp.stack([zero, one, zero]), jnp.stack([one, zero, zero]))
    across = gradient_safe.normalize(cross(begin, other))
    return jnp.where(sine > _SMALL_SINE, normal / jnp.maximum(sine, _SMALL_SINE), across), sine


def _rotated(axis: Vector, c: Scalar, s: Scalar, vector: Vector) -> Vector:
    """Vector turned about a unit axis by an angle with that cosine and sine; where there is no axis, as it is."""
    along = (1.0 - c) * jnp.sum(axis * vector, axis=0)
    return c * vector + s * cross(axis, vector) + along * axis


_LEAST_DISTANCE: Final = 1e-3
"""Distance that is divided by, at least [m]: far below any that is flown."""
_SMALL_SINE: Final = 1e-6
"""Sine of an angle below which its plane is rounding [-]."""
_ALONG: Final = 0.9
"""Component along an axis from which on it is not taken for one across [-]."""
