"""Forced circular motion around the target; a free fly-around is a relative orbit."""

from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.declared_numbers import number
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import arctan2, cos_sin
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import pytree
from rpojax.core.vectors import cross
from rpojax.flight.guidance.references.phase_entry import PhaseEntry, from_entry, slowing_down, smooth_step
from rpojax.value_types import Direction

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class FlyAround:
    """Circle around the target in the Hill frame."""

    radius: Array = number("radius of the circle", unit="m", above=0.0)
    axis: Array = number("normal of the circle's plane, H; any length", form=Direction)
    rate: Array = number("rate of the angle about the axis, right-handed", unit="deg_h")
    join: Array = number(
        "time in which the servicer reaches the circle from its place at the entry", unit="s", at_least=0.0, default=0.0
    )
    start: Array | None = number(
        "angle at the entry, from the along-track direction projected into the plane or, where the axis is along-track "
        "itself, the radial one; by default that of the position or, where that is nearer to the axis than a twentieth "
        "of the radius and noise decides on its angle, 0",
        unit="deg",
        default=None,
    )


def state(reference: FlyAround, entry: PhaseEntry, orbit: TargetOrbit, elapsed: Scalar) -> Float[Array, "6"]:
    """Desired relative state in H [m, m/s] `elapsed` [s] after the entry, with the target's `orbit` then.

    During the join the distance, the elevation above the circle's plane and the angle about the axis go over from those
    of the entry to those of the circle, each by itself, so that the distance stays between the two. The velocity that
    the servicer has at the entry besides is slowed down on a way of at most a tenth of the lesser distance.
    """
    del orbit
    axis, place = gradient_safe.normalize(reference.axis), entry.relative_state[:3]
    zero, in_plane = _zero_direction(axis), _across(axis, place)
    is_aside = gradient_safe.norm(in_plane) > _ON_AXIS_SHARE * reference.radius
    # What a servicer on the axis has beside it is closed without a turn.
    aside, beside = jnp.where(is_aside, in_plane, 0.0), jnp.where(is_aside, 0.0, in_plane)
    height = jnp.sum(axis * place, axis=0)
    elevation = arctan2(height, gradient_safe.norm(aside))
    farther = jnp.where(is_aside, gradient_safe.norm(place), jnp.abs(height)) - reference.radius
    angle, lead = reference.rate * elapsed, jnp.zeros_like(height)
    if reference.start is None:
        zero = gradient_safe.normalize(jnp.where(is_aside, in_plane, zero))
    else:
        angle = angle + reference.start
        at_entry = arctan2(jnp.sum(cross(axis, zero) * aside, axis=0), jnp.sum(zero * aside, axis=0))
        lead = jnp.where(is_aside, _within_half_a_turn(at_entry - reference.start), 0.0)
    share, slope, _ = smooth_step(elapsed, reference.join)
    rest = 1.0 - share
    c, s = cos_sin(angle + rest * lead)
    rise_c, rise_s = cos_sin(rest * elevation)
    outward, ahead = c * zero + s * cross(axis, zero), c * cross(axis, zero) - s * zero
    direction, upward = rise_c * outward + rise_s * axis, rise_c * axis - rise_s * outward
    distance = reference.radius + rest * farther
    turned = distance * ((reference.rate - slope * lead) * rise_c * ahead - slope * elevation * upward)
    velocity = turned - slope * (farther * direction + beside)
    moving = jnp.concatenate([distance * direction + rest * beside, velocity])
    excess = entry.relative_state[3:] - reference.rate * cross(axis, aside)
    lesser = jnp.clip(gradient_safe.norm(place), _ON_AXIS_SHARE * reference.radius, reference.radius)
    moving = moving + slowing_down(excess, elapsed, reference.join, _SLOWING_SHARE * lesser)
    return jnp.where(reference.join > 0.0, from_entry(entry, elapsed, moving), moving)


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


def _within_half_a_turn(angle: Scalar) -> Scalar:
    """The same direction as an angle from -pi to pi [rad]."""
    return angle - 2.0 * jnp.pi * jnp.round(angle / (2.0 * jnp.pi))


_ALONG_TRACK_COSINE: Final = 0.999
"""Component of an axis above which it counts as along-track [-]: 2.6 deg, where what is left across it is 0.045."""
_ON_AXIS_SHARE: Final = 0.05
"""Distance from the axis, over the radius, up to which a servicer counts as on it [-]. A choice: 2.9 deg, more than an
estimate errs by, so that its error does not choose the angle."""
_SLOWING_SHARE: Final = 0.1
"""Longest way on which the velocity at the entry is slowed down, over the lesser of both distances [-]. A choice: joins
of the packaged `fly_around` to 30 m come no nearer than 28.8 m (experiments/missions)."""
