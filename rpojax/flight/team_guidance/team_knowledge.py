"""The team as one servicer knows it, from its own estimate and what the others sent."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import arctan2
from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import pytree
from rpojax.core.vectors import apply
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.team_guidance.known_peers import KnownPeers
from rpojax.flight.team_guidance.team_situation import TeamSituation
from rpojax.flight.team_guidance.team_tuning import TeamTuning

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class Own:
    """What a servicer knows of itself alone.

    Attributes:
        follows: () bool, whether it follows the reference of its phase
        shift: () angle by which its relative orbit is, or is to be, ahead of the plan [rad]
        shift_left: () part of it that is still to come [rad]
        present: (N,) bool, those that were in the team when it was chosen
        state_H: (6,) relative state [m, m/s]
        planned: (3,) amplitudes of the relative orbit, radial and across [m], and the lead of the latter [rad]
    """

    follows: Array
    shift: Array
    shift_left: Array
    present: Array
    state_H: Array
    planned: Array


def situation(
    peers: KnownPeers,
    tuning: TeamTuning,
    estimate: OrbitEstimate,
    orbit: TargetOrbit,
    slots: Float[Array, " N"],
    own: Own,
    clearance: Scalar,
    sun_N: Vector,
    time: Scalar,
) -> TeamSituation:
    """The whole team as one servicer knows it.

    Args:
        peers: what it knows of the others
        tuning: of the guidance of the team
        estimate: of both orbits
        orbit: of the target
        slots: (N,) phases by the plan [rad]
        own: of itself alone
        clearance: () distance that is kept between servicers [m]
        sun_N: (3,) position of the Sun [m]
        time: () since the start [s]
    """
    r_TN_N = estimate.servicer.r_SN_N + estimate.relative.r_TS_N
    R_HN, omega_HN_N = hill_frame(r_TN_N, estimate.servicer.v_SN_N + estimate.relative.v_TS_N)
    count = slots.shape[0]

    def phase(state: Float[Array, "6"]) -> Scalar:
        constants = yamanaka_ankersen.constants_of_motion(orbit, state)
        return arctan2(constants[2], constants[1])

    def of_peer(_: None, state_N: Float[Array, "6"]) -> tuple[None, Scalar]:
        return None, phase(own.state_H + jnp.concatenate(inertial_to_hill(state_N[:3], state_N[3:], R_HN, omega_HN_N)))

    _, believed = jax.lax.scan(of_peer, None, peers.state_N)
    heard = peers.intents.follows & (time - peers.intents.time < tuning.lost_after)
    return TeamSituation(
        own=jnp.arange(count, dtype=jnp.int32) == peers.number,
        present=_of_all(peers, count, own.follows, heard),
        slots=slots,
        shifts=_of_all(peers, count, own.shift, peers.intents.shift),
        shift_left=own.shift_left,
        present_before=own.present,
        believed=_of_all(peers, count, phase(own.state_H), believed),
        radial=own.planned[0],
        cross_track=own.planned[1],
        cross_track_lead=own.planned[2],
        clearance=clearance,
        argument_of_latitude=yamanaka_ankersen.mean_argument_of_latitude(orbit),
        mean_motion=mean_motion(orbit.semi_major_axis),
        sun_H=apply(R_HN, gradient_safe.normalize(sun_N)),
        time=time,
        last_seen=peers.last_seen,
    )


def _of_all(peers: KnownPeers, count: int, one: Array, others: Float[Array, " peers"] | Bool[Array, " peers"]) -> Array:
    """Values (N,) in the order of the scenario from the own one and those of the peers."""
    places = jnp.concatenate([peers.number[None], peers.numbers])
    values = jnp.concatenate([one[None], others])
    chosen = places[None] == jnp.arange(count, dtype=jnp.int32)[:, None]
    if values.dtype == bool:
        return jnp.any(chosen & values[None], axis=1)
    return jnp.sum(jnp.where(chosen, values[None], 0.0), axis=1)
