"""Forced circular motion around the target; a free fly-around is a relative orbit."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import cos_sin
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import pytree
from rpojax.core.vectors import cross
from rpojax.flight.guidance.references.phase_entry import PhaseEntry, joined

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class FlyAround:
    """Circle around the target in the Hill frame.

    Attributes:
        radius: () [m]
        axis: (3,) normal of the circle's plane in H, of any length [-]
        rate: () of the angle about the axis, right-handed [rad/s]
        join: () time in which the servicer reaches the circle from its motion at the entry [s]
        start: () angle at the entry, from the along-track direction projected into the plane or, where the axis is
            along-track, from the radial one [rad]; None for that of the servicer's position at the entry
    """

    radius: Array
    axis: Array
    rate: Array
    join: Array
    start: Array | None = None


def state(reference: FlyAround, entry: PhaseEntry, orbit: TargetOrbit, elapsed: Scalar) -> Float[Array, "6"]:
    """Desired relative state in H [m, m/s] `elapsed` [s] after the entry, with the target's `orbit` then."""
    axis = gradient_safe.normalize(reference.axis)
    zero = _zero_direction(axis)
    angle = reference.rate * elapsed
    if reference.start is None:
        # A servicer on the axis starts at the angle 0.
        in_plane = _across(axis, entry.relative_state[:3])
        off_axis = jnp.sum(in_plane * in_plane, axis=0) > 0.0
        zero = gradient_safe.normalize(jnp.where(off_axis, in_plane, zero))
    else:
        angle = angle + reference.start
    ahead = cross(axis, zero)
    c, s = cos_sin(angle)
    radial, tangential = c * zero + s * ahead, c * ahead - s * zero
    wanted = jnp.concatenate([reference.radius * radial, reference.radius * reference.rate * tangential])
    return joined(entry, elapsed, reference.join, wanted)


def _zero_direction(axis: Vector) -> Vector:
    """Direction in the plane across the axis from which angles count."""
    x, y, _ = axis
    zero, one = jnp.zeros_like(x), jnp.ones_like(x)
    along_track = jnp.abs(y) > _ALONG_TRACK_COSINE
    direction = jnp.where(along_track, jnp.stack([one, zero, zero]), jnp.stack([zero, one, zero]))
    return gradient_safe.normalize(_across(axis, direction))


def _across(axis: Vector, vector: Vector) -> Vector:
    """Part of a vector across the axis."""
    return vector - jnp.sum(axis * vector, axis=0) * axis


_ALONG_TRACK_COSINE = 0.999
"""Component of an axis above which it counts as along-track [-]."""
