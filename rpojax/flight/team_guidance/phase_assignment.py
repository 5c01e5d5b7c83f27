"""Phases of a team on one relative orbit: by viewpoints, or spread anew when a servicer is left out.

To spread them, the servicers that are left take the pattern of the first slots of the plan, so that neighbours are as
far apart as it wants them, whose bearings then cross as it wants them to. The pattern may be turned, in steps, and
reversed. Of all these, that one is taken for which the servicers have to go least far, and that leads nobody past one
that was left out, or near to it, since it drifts on where it was. Each servicer decides for itself: the cost is made of
the plan, so that all who know the same come to the same.
"""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.flight.mission.static_mission_settings import MissionSettings
from rpojax.flight.team_guidance import viewpoint_assignment
from rpojax.flight.team_guidance.team_situation import TeamSituation, TeamTuning, least_angle, wrapped

Scalar = Float[Array, ""]

_STEPS = 24
"""Turns of the pattern that are tried, over a whole one. A choice: one in 15 deg, which leads servicers 0.3 deg farther
(rms) than the best in the mean, half as many 1.0, twice 0.15."""
_BLOCKED = 1e3
"""Cost of going past a servicer that is left out, or near to it [rad^2]: more than all ways of 100 servicers."""
_CLEAR = 2.0
"""Angle to one that is left out over the least one: its motion is known less and less. A choice."""


def assign(settings: MissionSettings, tuning: TeamTuning, team: TeamSituation) -> Scalar:
    """Angle by which this servicer's relative orbit is to be ahead of the plan [rad], as the settings want it."""
    if settings.phasing == "viewpoints":
        return viewpoint_assignment.assign(tuning, team)
    return spread(team)


def spread(team: TeamSituation) -> Scalar:
    """Angle by which this servicer's relative orbit is to be ahead of the plan [rad]."""
    count = team.slots.shape[0]
    before = jnp.arange(count)[None] < jnp.arange(count)[:, None]
    rank = jnp.sum((team.present[None] & before).astype(jnp.int32), axis=1)
    pattern = wrapped(team.slots - team.slots[0])
    of_rank = jnp.sum(jnp.where(rank[:, None] == jnp.arange(count)[None], pattern[None], 0.0), axis=1)
    turns = team.slots[0] + jnp.asarray(2.0 * math.pi / _STEPS * np.arange(_STEPS))
    phases = jnp.concatenate([turns[:, None] + of_rank[None], turns[:, None] - of_rank[None]])
    changes = wrapped(phases - team.slots[None])
    far = jnp.sum(jnp.where(team.present[None], changes**2, 0.0), axis=1)
    blocked = _is_blocked(team, changes) & team.present[None, :, None] & ~team.present[None, None]
    cost = far + jnp.sum(jnp.where(blocked, _BLOCKED, 0.0), axis=(1, 2))
    chosen = jnp.arange(2 * _STEPS) == jnp.argmin(cost, axis=0)
    wanted = jnp.sum(jnp.where(chosen[:, None] & team.own[None], changes, 0.0), axis=(0, 1))
    return jnp.where(jnp.all(team.present, axis=0), 0.0, wanted)


def _is_blocked(team: TeamSituation, changes: Float[Array, "c N"]) -> Array:
    """Whether a change of the phase of one servicer leads past another one, or to its place (c, N, N)."""
    to_other = wrapped(team.believed[None] - team.slots[:, None])
    change = changes[:, :, None]
    ahead = to_other[None] * jnp.sign(change)
    passes = (ahead > 0.0) & (ahead < jnp.abs(change))
    return passes | (jnp.abs(wrapped(to_other[None] - change)) < _CLEAR * least_angle(team))
