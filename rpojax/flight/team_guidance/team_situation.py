"""What a servicer knows of its team when it decides about the phase of its relative orbit, and by what numbers."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import arctan2
from rpojax.core.pytree import pytree

Angles = Float[Array, "*shape"]


@pytree
class TeamTuning:
    """Numbers of the guidance of a team, the same for all servicers.

    Attributes:
        keep_out: () radius around another servicer's free drift that no burn may lead into [m]
        lost_after: () age of the latest message of a servicer after which it is left out [s]
        phase_rate: () at which relative orbits shift [rad/s]
        view_incidence: () greatest angle at which a side of the target counts as seen [rad]
        view_sun_incidence: () the same for sunlight [rad]
        view_memory: () time after which most of what was seen is worth seeing again [s]
        keeping_delta_v: () what a servicer needs without a shift, in the time for which viewpoints are chosen [m/s]
    """

    keep_out: Array
    lost_after: Array
    phase_rate: Array
    view_incidence: Array
    view_sun_incidence: Array
    view_memory: Array
    keeping_delta_v: Array


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
