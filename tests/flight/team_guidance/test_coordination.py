"""What each of two servicers knows after the messages of a tick, of which only one arrives."""

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.flight.cooperation.estimate_sharing import Baselines, EstimateSharing
from rpojax.flight.cooperation.sharing import SharingMemory
from rpojax.flight.cooperation.team_settings import LinkSettings
from rpojax.flight.team_guidance import coordination
from rpojax.flight.team_guidance.coordination import Announcements, Coordination
from rpojax.flight.team_guidance.intent import Intent
from rpojax.flight.team_guidance.team_knowledge import KnownPeers
from rpojax.flight.team_guidance.team_situation import TeamTuning

SETTINGS = LinkSettings(2, "estimates", 1, 0, ((0, 1), (1, 0)), 0)
TIME, SHIFTS, SLOTS = 100.0, [0.1, 0.2], [[0.0, 1.5]]
PLACES = np.array([[30.0, -30.0], [0.0, 0.0], [0.0, 0.0]])
SUN_H = np.array([0.0, 0.0, 1.5e11])


def tuning() -> TeamTuning:
    unused, right_angle = jnp.zeros(()), jnp.asarray(np.deg2rad(89.0))
    return TeamTuning(
        keep_out=unused,
        lost_after=unused,
        phase_rate=unused,
        view_incidence=right_angle,
        view_sun_incidence=right_angle,
        view_memory=unused,
        keeping_delta_v=unused,
    )


@jax.jit
def after_a_tick() -> tuple[KnownPeers, Coordination]:
    """Both see the target and say so; the second servicer alone receives what the other one says."""
    pair = jnp.full(2, TIME)
    plans = Intent(
        time=pair,
        follows=jnp.ones(2, dtype=bool),
        delta_v_N=jnp.zeros((3, 2)),
        burn_time=pair,
        shift=jnp.asarray(SHIFTS),
        sees=jnp.ones(2, dtype=bool),
    )
    announced = Announcements(
        plans=plans,
        slots=jnp.asarray(SLOTS),
        place_H=jnp.asarray(PLACES),
        R_HN=jnp.stack([jnp.eye(3)] * 2, axis=-1),
        sun_H=jnp.stack([jnp.asarray(SUN_H)] * 2, axis=-1),
    )
    to_peer = np.concatenate([PLACES[:, ::-1] - PLACES, np.zeros((3, 2))])[None]
    covariance = jnp.stack([jnp.eye(6)] * 2, axis=-1)[None]
    baselines = Baselines(mean=jnp.asarray(to_peer), covariance=covariance, of_own=covariance)
    sharing = SharingMemory(
        line=None,
        burns=None,
        attitude_variance=None,
        last_received=None,
        messages_used=None,
        estimates=EstimateSharing(baselines=baselines),
    )
    before = coordination.initial(SETTINGS, jnp.asarray(0.0), maps_directions=True)
    return coordination.share(SETTINGS, tuning(), before, sharing, announced, jnp.array([[False, True]]))


def test_plans_and_sides_seen_are_those_of_the_messages_that_arrived() -> None:
    known, memory = after_a_tick()
    np.testing.assert_array_equal(known.number, [0, 1])
    np.testing.assert_array_equal(known.numbers, [[1, 0]])
    np.testing.assert_array_equal(known.intents.shift, [[0.0, SHIFTS[0]]])
    np.testing.assert_array_equal(known.intents.time, [[0.0, TIME]])
    np.testing.assert_array_equal(known.slots[..., 0], SLOTS)
    np.testing.assert_array_equal(known.slots[..., 1], SLOTS)
    normals = coordination.direction_map.DIRECTIONS
    lit = normals[2] > np.cos(np.deg2rad(89.0))
    by_first, by_second = (lit & (side * normals[0] > np.cos(np.deg2rad(89.0))) for side in (1.0, -1.0))
    assert by_first.any()
    assert by_second.any()
    np.testing.assert_array_equal(memory.last_seen[:, 0], np.where(by_first, TIME, -np.inf))
    np.testing.assert_array_equal(memory.last_seen[:, 1], np.where(by_first | by_second, TIME, -np.inf))
