"""The team as one servicer knows it: the motion and the plans of the others by their messages, and its own."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.filter_state_layout import MOTION
from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.numerics import gradient_safe
from rpojax.core.numerics.trigonometric_series import arctan2
from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import pytree
from rpojax.core.vectors import apply
from rpojax.flight.cooperation.sharing import SharingMemory
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.team_guidance.intent import Intent
from rpojax.flight.team_guidance.team_situation import TeamSituation, TeamTuning

Scalar = Float[Array, ""]


@pytree
class KnownPeers:
    """The other servicers as one of them knows them, (peers, ...).

    Attributes:
        state_N: (peers, 6) position [m] and velocity [m/s] from this servicer
        covariance_N: (peers, 6, 6)
        intents: latest plans of each that have arrived
        numbers: (peers,) int32, their places in the team
        number: () int32, the own one
        slots: (rows, N) phases of the relative orbits of all by the plan, in each phase of the mission [rad]
        last_seen: (directions,) when each side of the target was last seen by anybody [s], None if no one asks
    """

    state_N: Array
    covariance_N: Array
    intents: Intent
    numbers: Array
    number: Array
    slots: Array
    last_seen: Array | None = None


@pytree
class Own:
    """What a servicer knows without the others.

    Attributes:
        estimate: of both orbits
        orbit: of the target
        state_H: (6,) relative state [m, m/s]
        follows: () bool, whether it follows the reference of its phase
        shift: () angle by which its relative orbit is, or is to be, ahead of the plan [rad]
        shift_left: () part of it that is still to come [rad]
        present: (N,) bool, those that were in the team when it was chosen
        slots: (N,) phases of all by the plan [rad]
        planned: (3,) amplitudes of the relative orbit, radial and across [m], and the lead of the latter [rad]
        clearance: () distance that is kept between servicers [m]
        sun_N: (3,) position of the Sun [m]
    """

    estimate: OrbitEstimate
    orbit: TargetOrbit
    state_H: Array
    follows: Array
    shift: Array
    shift_left: Array
    present: Array
    slots: Array
    planned: Array
    clearance: Array
    sun_N: Array


def motion(memory: SharingMemory) -> tuple[Float[Array, "peers 6"], Float[Array, "peers 6 6"]]:
    """Position [m] and velocity [m/s] of the peers from this servicer in N, with covariance, by its filter."""
    if memory.joint is not None:
        count = memory.joint.peers.shape[0]
        covariances = [memory.joint.covariance.of_body(1 + k, 0) for k in range(count)]
        return memory.joint.peers[:, : MOTION.size], jnp.stack(covariances)
    assert memory.estimates is not None
    baselines = memory.estimates.baselines
    return baselines.mean[:, : MOTION.size], baselines.covariance[:, : MOTION.size, : MOTION.size]


def situation(tuning: TeamTuning, peers: KnownPeers, own: Own, time: Scalar) -> TeamSituation:
    """The whole team as one servicer knows it at `time` [s] since the start."""
    estimate, orbit, slots = own.estimate, own.orbit, own.slots
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
        clearance=own.clearance,
        argument_of_latitude=yamanaka_ankersen.mean_argument_of_latitude(orbit),
        mean_motion=mean_motion(orbit.semi_major_axis),
        sun_H=apply(R_HN, gradient_safe.normalize(own.sun_N)),
        time=time,
        last_seen=peers.last_seen,
    )


def _of_all(peers: KnownPeers, count: int, own: Array, others: Float[Array, " peers"] | Bool[Array, " peers"]) -> Array:
    """Values (N,) in the order of the scenario from the own one and those of the peers."""
    places = jnp.concatenate([peers.number[None], peers.numbers])
    values = jnp.concatenate([own[None], others])
    chosen = places[None] == jnp.arange(count, dtype=jnp.int32)[:, None]
    if values.dtype == bool:
        return jnp.any(chosen & values[None], axis=1)
    return jnp.sum(jnp.where(chosen, values[None], 0.0), axis=1)
