"""What a servicer knows of its team when it decides about the phase of its relative orbit, and by what numbers."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.declared_numbers import number
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import arctan2
from rpojax.core.pytree import pytree

Angles = Float[Array, "*shape"]


@pytree
class TeamTuning:
    """Numbers of the guidance of a team, the same for all servicers."""

    keep_out: Array = number(
        "radius around the free drift of another servicer that no burn may lead into; needs phases, and "
        "`navigation.sharing`; 0 for none",
        unit="m",
        at_least=0.0,
        default=0.0,
    )
    lost_after: Array = number(
        "age of the latest message of a servicer after which it is left out", unit="s", above=0.0, default=60.0
    )
    phase_rate: Array = number("rate at which phases change", unit="deg_h", above=0.0, default=60.0)
    view_incidence: Array = number(
        "greatest angle at which a side of the target counts as seen, for `viewpoints`",
        unit="deg",
        above=0.0,
        at_most=90.0,
        default=60.0,
    )
    view_sun_incidence: Array = number(
        "greatest angle at which sunlight on a side of the target counts as light, for `viewpoints`",
        unit="deg",
        above=0.0,
        at_most=90.0,
        default=70.0,
    )
    view_memory: Array = number("time after which most is worth seeing again", unit="s", above=0.0, default=6000.0)
    keeping_delta_v: Array = number(
        "what a servicer needs in a quarter of an orbit without a change of its phase; the larger it is, the more "
        "readily phases change, at a cost",
        unit="m_s",
        above=0.0,
        default=0.002,
    )


@pytree
class TeamSituation:
    """The team as one servicer knows it; arrays (N,) have all servicers in the order of the scenario.

    Attributes:
        own: (N,) bool, true for itself
        present: (N,) bool, those that follow their phase, and were heard of not long ago
        slots: (N,) phases of their relative orbits by the plan [rad]
        shifts: (N,) by which these are, or are to be, ahead of it by their latest messages [rad]
        shift_left: () part of the own shift that is still to come [rad]
        present_before: (N,) bool, those that were present when that was chosen
        believed: (N,) phases of their relative orbits by the estimate of their motion [rad]
        radial: () amplitude of the relative orbits [m]
        cross_track: () amplitude across the orbit plane [m]
        cross_track_lead: () phase of that less the radial one [rad]
        clearance: () distance that is kept between servicers [m]
        argument_of_latitude: () of the target, mean [rad]
        mean_motion: () [rad/s]
        sun_H: (3,) direction to the Sun
        time: () since the start [s]
        last_seen: (directions,) when each direction of `direction_map` was last seen from [s], None if no one asks
    """

    own: Array
    present: Array
    slots: Array
    shifts: Array
    shift_left: Array
    present_before: Array
    believed: Array
    radial: Array
    cross_track: Array
    cross_track_lead: Array
    clearance: Array
    argument_of_latitude: Array
    mean_motion: Array
    sun_H: Array
    time: Array
    last_seen: Array | None = None


def wrapped(angle: Angles) -> Angles:
    """Angle between minus and plus half a turn [rad]."""
    return angle - 2.0 * math.pi * jnp.round(angle / (2.0 * math.pi))


def least_angle(team: TeamSituation) -> Float[Array, ""]:
    """Difference in phase at which two servicers on the relative orbit are as far from each other as is kept [rad].

    The difference of two relative orbits whose eccentricity and inclination vectors are parallel has parallel ones,
    with `2 sin(angle / 2)` times the amplitudes: it never comes nearer than the smaller one.
    """
    smaller = jnp.minimum(team.radial, team.cross_track)
    sine = jnp.clip(0.5 * team.clearance / jnp.where(smaller > 0.0, smaller, 1.0), 0.0, 1.0)
    half = arctan2(sine, gradient_safe.sqrt(1.0 - sine * sine))
    return jnp.where(smaller > 0.0, 2.0 * half, math.pi)
