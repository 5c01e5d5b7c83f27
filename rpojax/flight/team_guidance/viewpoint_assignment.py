"""Greedy assignment of viewpoints: the phases on the relative orbit from which most that is new is seen per delta-v.

One servicer after the other takes, of some phases beside its present one, that for which the sides of the target that
it will see and that nobody saw before or is to see, divided by the delta-v of going there, are most. Nobody goes near
to another one. Greedy maximisation of what is covered gives at least 63 % of the best (Nemhauser, Wolsey and Fisher,
1978), without the division. Each servicer decides so for all, and does its own part.
"""

import math
from typing import Final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics.trigonometric_series import cos_sin
from rpojax.flight.team_guidance import direction_map
from rpojax.flight.team_guidance.team_situation import TeamSituation, TeamTuning, least_angle, wrapped

Scalar = Float[Array, ""]

_STEPS: Final = np.deg2rad(np.array([0.0, -30.0, 30.0, -60.0, 60.0, -90.0, 90.0]))
"""Changes of the phase that are tried [rad]. A choice: as far as the horizon, in thirds."""
_SAMPLES: Final = 6
"""Places in the horizon at which sides count [-]. A choice: one in 15 deg, less than between directions of the map."""
_HORIZON: Final = 0.5 * math.pi
"""Argument of latitude over which viewpoints are chosen [rad]. A choice: the Sun turns by as much in H."""
_ARRIVED: Final = 1e-6
"""Part of a shift still to come at which it is over [rad]: 0.03 mm at 30 m."""
_LEAST_SPACING: Final = math.radians(45.0)
"""Difference in phase below which the bearings of two servicers hardly measure the range [rad]. A choice: bearings that
cross at 45 deg have 1.4 (1 / sin 45 deg) times its sigma of those at right angles."""


def assign(tuning: TeamTuning, team: TeamSituation) -> Scalar:
    """Angle by which this servicer's relative orbit is to be ahead of the plan [rad].

    A servicer that is under way arrives first, unless the team has changed.
    """
    assert team.last_seen is not None
    count, steps = team.slots.shape[0], jnp.asarray(_STEPS)
    worth = direction_map.worth(tuning, team.last_seen, team.time)
    phases = jnp.where(team.present, team.slots + team.shifts, team.believed)
    cost = tuning.keeping_delta_v + _delta_v(team, steps)
    spacing = jnp.maximum(least_angle(team), _LEAST_SPACING)
    shift = jnp.zeros_like(worth[0])
    for number in range(count):
        seen = _seen(tuning, team, phases[number] + steps)
        gain = jnp.sum(jnp.where(seen, worth[:, None], 0.0), axis=0) / cost
        others = jnp.arange(count) != number
        apart = jnp.abs(wrapped(phases[None] - phases[number] - steps[:, None]))
        is_free = jnp.all((apart >= spacing) | ~others[None], axis=1) | (steps == 0.0)
        best = jnp.arange(steps.shape[0]) == jnp.argmax(jnp.where(is_free, gain, -1.0), axis=0)
        best = best & team.present[number]
        step = jnp.sum(jnp.where(best, steps, 0.0), axis=0)
        phases = phases + jnp.where(others, 0.0, step)
        worth = jnp.where(jnp.any(seen & best[None], axis=1), 0.0, worth)
        shift = shift + jnp.where(team.own[number], team.shifts[number] + step, 0.0)
    under_way = (jnp.abs(team.shift_left) > _ARRIVED) & jnp.all(team.present == team.present_before, axis=0)
    return jnp.where(under_way, jnp.sum(jnp.where(team.own, team.shifts, 0.0), axis=0), shift)


def _delta_v(team: TeamSituation, steps: Float[Array, " k"]) -> Float[Array, " k"]:
    """Delta-v of a change of the phase [m/s]: two burns along the track, and one across it (D'Amico, 2010)."""
    chord = 2.0 * jnp.sin(0.5 * jnp.abs(steps))
    return team.mean_motion * chord * (0.5 * team.radial + team.cross_track)


def _seen(tuning: TeamTuning, team: TeamSituation, phases: Float[Array, " k"]) -> Bool[Array, "directions k"]:
    """Sides of the target that are seen from the relative orbits of these phases [rad] within the horizon."""
    ahead = jnp.asarray(_HORIZON / _SAMPLES * np.arange(1, _SAMPLES + 1))
    seen = jnp.zeros((direction_map.COUNT, phases.shape[0]), dtype=bool)
    for number in range(_SAMPLES):
        u = team.argument_of_latitude + ahead[number]
        c, s = cos_sin(u - phases)
        _, across = cos_sin(u - phases - team.cross_track_lead)
        place_H = jnp.stack([-team.radial * c, 2.0 * team.radial * s, team.cross_track * across])
        turn_c, turn_s = cos_sin(ahead[number])
        x, y, z = team.sun_H
        sun_H = jnp.stack([turn_c * x + turn_s * y, turn_c * y - turn_s * x, z])
        seen = seen | direction_map.is_seen(tuning, place_H, jnp.broadcast_to(sun_H[:, None], place_H.shape))
    return seen
