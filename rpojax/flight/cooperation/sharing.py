"""Exchange of messages between the servicers of a team, and what their filters make of it.

All records have the servicers along the last axis; each servicer's part is a function of its own records and of the
messages that it received.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.batching import batching_mode
from rpojax.core.numerics import double_single
from rpojax.core.orbits import two_body_gravity
from rpojax.core.pytree import pytree, replace
from rpojax.flight.cooperation import (
    box_sharing,
    burn_effect,
    estimate_sharing,
    free_relative_motion,
    joint_filter,
    joint_measurements,
    message,
    peer_news,
)
from rpojax.flight.cooperation.burn_effect import BurnSum
from rpojax.flight.cooperation.estimate_sharing import EstimateSharing
from rpojax.flight.cooperation.joint_filter import JointEstimate
from rpojax.flight.cooperation.link_settings import BaselineTuning, LinkSettings
from rpojax.flight.cooperation.message import Message
from rpojax.flight.cooperation.peer_news import Heard, News
from rpojax.flight.cooperation.team_records import TeamRecords, for_receivers
from rpojax.flight.navigation import burn_execution_error
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement
from rpojax.flight.navigation.relative_state import RelativeEstimate

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class SharingMemory:
    """Memory of one servicer, or of all along the last axis.

    Attributes:
        line: its messages of the last ticks, newest first along the first axis
        burns: sum of the effects of its burns
        attitude_variance: () sum of the changes of its attitude's variance [rad^2]
        heard: of its peers
        news_used: (peers,) bool, what the peer sent was used in the latest tick
        joint: joint estimate, None unless boxes are shared
        estimates: of the target and the baselines, None unless estimates are shared
    """

    line: Message
    burns: BurnSum
    attitude_variance: Array
    heard: Heard
    news_used: Array
    joint: JointEstimate | None = None
    estimates: EstimateSharing | None = None


@pytree
class _Peers:
    """Hand-over of the peers of a servicer, (peers, ...)."""

    tuning: OrbitFilterTuning
    orbit: OrbitEstimate


def initial(
    settings: LinkSettings, baseline: BaselineTuning, tuning: OrbitFilterTuning, records: TeamRecords
) -> SharingMemory:
    """Memory at hand-over, from the records of all servicers, of which only the orbits count."""
    peers = for_receivers(_Peers(tuning=tuning, orbit=records.orbit), settings.peers)

    def of_one(tuning: OrbitFilterTuning, peers: _Peers, records: TeamRecords) -> SharingMemory:
        own, baselines = records.orbit.relative, _baselines(records.orbit, peers.orbit)
        zero = jnp.zeros_like(own.r_TS_N[0])
        memory = SharingMemory(
            line=_message(
                settings, records, jnp.zeros((), dtype=bool), burn_effect.initial(), zero, own, own.covariance, zero
            ),
            burns=burn_effect.initial(),
            attitude_variance=zero,
            heard=peer_news.initial(settings.servicers - 1),
            news_used=jnp.zeros(settings.servicers - 1, dtype=bool),
        )
        memory = replace(memory, line=message.delay_line(memory.line, settings.delay_ticks))
        if settings.sharing in ("boxes", "central"):
            joint = joint_filter.initial(tuning, baseline, own, baselines, peers.tuning, settings.ranging)
            return replace(memory, joint=joint)
        is_naive = settings.sharing == "naive"
        estimates = estimate_sharing.initial(tuning, baseline, own, baselines, peers.tuning, is_naive, settings.ranging)
        return replace(memory, estimates=estimates)

    return batching_mode.transform()(of_one, in_axes=-1, out_axes=-1)(tuning, peers, records)


def _baselines(own: OrbitEstimate, peers: OrbitEstimate) -> Float[Array, "peers 6"]:
    """Position [m] and velocity [m/s] of the peers from a servicer by the absolute orbits."""
    rows = []
    low = own.servicer.orbit_low
    for k in range(peers.servicer.r_SN_N.shape[0]):
        peer = jax.tree.map(lambda leaf, k=k: leaf[k], peers.servicer)
        lows = (None, None) if low is None else low, (None, None) if low is None else peer.orbit_low
        position = double_single.subtract(peer.r_SN_N, lows[1][0], own.servicer.r_SN_N, lows[0][0])
        velocity = double_single.subtract(peer.v_SN_N, lows[1][1], own.servicer.v_SN_N, lows[0][1])
        rows.append(jnp.concatenate([position, velocity]))
    return jnp.stack(rows)


def _message(
    settings: LinkSettings,
    records: TeamRecords,
    accepted: Bool[Array, ""],
    burns: BurnSum,
    attitude_variance: Scalar,
    own: RelativeEstimate,
    correlated: Float[Array, "n n"],
    time: Scalar,
) -> Message:
    """Message of one servicer; with estimates that of the target is `own`, with the `correlated` part."""
    shares_boxes = settings.sharing in ("boxes", "central")
    return Message(
        time=time,
        gps=records.gps,
        burns=burns.at_start,
        from_start=burns.from_start,
        q_KN=records.q_KN,
        attitude_variance=attitude_variance,
        box=_gated(records.box, accepted) if shares_boxes else None,
        track=None if shares_boxes else estimate_sharing.target_track(own, correlated),
        ranges=records.ranges,
    )


def _gated(box: BoxMeasurement, accepted: Bool[Array, ""]) -> BoxMeasurement:
    """The box as far as it passed the gate; a frame with a false one tells nothing."""
    return replace(box, present=accepted, expected=box.expected & (accepted | ~box.present))


def share(
    settings: LinkSettings,
    baseline: BaselineTuning,
    tuning: OrbitFilterTuning,
    focal_px: Float[Array, " N"],
    records: TeamRecords,
    memory: SharingMemory,
    received: Bool[Array, "N N"],
    time: Scalar,
    tick_s: float,
) -> tuple[TeamRecords, SharingMemory]:
    """Records and memory after own boxes and messages of a tick.

    Args:
        settings: static settings
        baseline: belief in differences of GPS positions
        tuning: of the orbit filters
        focal_px: (N,) of the cameras [px]
        records: after navigation
        memory: of the tick before
        received: (N, N) bool, which receiver gets the message of which sender that is due now
        time: () since the start [s]
        tick_s: camera period [s]
    """
    delay = settings.delay_ticks * tick_s

    def send(records: TeamRecords, tuning: OrbitFilterTuning, focal_px: Scalar, memory: SharingMemory) -> SharingMemory:
        return _sent(settings, records, tuning, focal_px, memory, time)

    memory = batching_mode.transform()(send, in_axes=-1, out_axes=-1)(records, tuning, focal_px, memory)
    arrived = _Arrived(messages=message.oldest(memory.line), tuning=tuning, focal_px=focal_px)
    arrived = for_receivers(arrived, settings.peers)
    heard = jnp.stack([jnp.stack([received[i, j] for j in row]) for i, row in enumerate(settings.peers)], axis=-1)

    def receive(
        records: TeamRecords,
        tuning: OrbitFilterTuning,
        focal_px: Scalar,
        memory: SharingMemory,
        arrived: _Arrived,
        heard: Bool[Array, " peers"],
    ) -> tuple[RelativeEstimate, SharingMemory]:
        # What a failed sender would say may not be a number.
        none = jax.tree.map(jnp.zeros_like, arrived.messages)
        news, latest = peer_news.read(
            memory.heard,
            peer_news.select_peers(heard, arrived.messages, none),
            heard,
            memory.burns,
            message.oldest(memory.line),
            arrived.tuning,
            arrived.focal_px,
            _forth(records, delay),
            time,
        )
        memory = replace(memory, heard=latest)
        return _received(settings, baseline, tuning, focal_px, records, memory, news, delay)

    relative, memory = batching_mode.transform()(receive, in_axes=-1, out_axes=-1)(
        records, tuning, focal_px, memory, arrived, heard
    )
    return replace(records, orbit=replace(records.orbit, relative=relative)), memory


@pytree
class _Arrived:
    """What arrives from the peers of a servicer, (peers, ...)."""

    messages: Message
    tuning: OrbitFilterTuning
    focal_px: Array


def _forth(records: TeamRecords, delay: float) -> Float[Array, "6 6"] | None:
    """State transition matrix from the time stamps of what arrives to now, None without delay."""
    if delay == 0.0:
        return None
    gradient = two_body_gravity.gravity_gradient(records.orbit.servicer.r_SN_N)
    return free_relative_motion.transition_matrix(gradient, delay)


def _sent(
    settings: LinkSettings,
    records: TeamRecords,
    tuning: OrbitFilterTuning,
    focal_px: Scalar,
    memory: SharingMemory,
    time: Scalar,
) -> SharingMemory:
    """Memory of a servicer after the message of a tick."""
    accepted, own = records.accepted, records.orbit.relative
    correlated = own.covariance
    box = _gated(records.box, accepted)
    estimates = memory.estimates
    if settings.sharing == "estimates":
        assert estimates is not None
        estimates = estimate_sharing.update(
            tuning, focal_px, estimates, records.orbit, records.q_KN, box, records.gate.recovered, records.rows
        )
        assert estimates.local is not None
        assert estimates.correlated is not None
        own, correlated = estimates.local, estimates.correlated
    attitude_variance = memory.attitude_variance + records.box.attitude_variance_change
    new = _message(settings, records, accepted, memory.burns, attitude_variance, own, correlated, time)
    return replace(
        memory, line=message.push(memory.line, new), attitude_variance=attitude_variance, estimates=estimates
    )


def _received(
    settings: LinkSettings,
    baseline: BaselineTuning,
    tuning: OrbitFilterTuning,
    focal_px: Scalar,
    records: TeamRecords,
    memory: SharingMemory,
    news: News,
    delay: float,
) -> tuple[RelativeEstimate, SharingMemory]:
    """Estimate of the target and memory of a servicer after the messages of a tick."""
    if memory.joint is not None:
        box, joint = _gated(records.box, records.accepted), memory.joint
        if records.rows is not None:
            joint = joint_measurements.update_by_rows(joint, records.rows)
        joint, is_used = box_sharing.update(
            tuning,
            baseline,
            focal_px,
            joint,
            records.orbit,
            records.q_KN,
            box,
            records.gate.recovered,
            news,
            delay,
        )
        return joint_filter.own_estimate(joint), replace(memory, joint=joint, news_used=is_used)
    assert memory.estimates is not None
    receive = estimate_sharing.receive_naively if settings.sharing == "naive" else estimate_sharing.receive
    estimates, relative = receive(baseline, memory.estimates, records.orbit, news, delay)
    return relative, replace(memory, estimates=estimates, news_used=news.used)


def predict(
    settings: LinkSettings,
    tuning: OrbitFilterTuning,
    memory: SharingMemory,
    before: OrbitEstimate,
    after: OrbitEstimate,
    delta_v_N: Float[Array, "3 N"],
    burn_delta_v: Float[Array, " N"],
    burn_sigma_inflation: Float[Array, " N"],
    reopened: Bool[Array, " N"],
    tick_s: float,
) -> SharingMemory:
    """Memory one tick later.

    Args:
        settings: static settings
        tuning: of the orbit filters
        memory: after the messages of the tick
        before: orbit estimates after guidance
        after: the same, predicted to the end of the tick
        delta_v_N: (3, N) expected velocity changes in between [m/s]
        burn_delta_v: (N,) sizes of the whole burns that they are parts of [m/s]
        burn_sigma_inflation: (N,) factors on the sigma of the burns' magnitude
        reopened: (N,) bool, guidance has widened the estimate of the target in this tick, as a search of it has failed
        tick_s: camera period [s]
    """

    def of_one(
        tuning: OrbitFilterTuning,
        memory: SharingMemory,
        before: OrbitEstimate,
        after: OrbitEstimate,
        delta_v_N: Vector,
        burn_delta_v: Scalar,
        inflation: Scalar,
        reopened: Bool[Array, ""],
    ) -> SharingMemory:
        covariance = burn_execution_error.burn_covariance(
            delta_v_N, burn_delta_v, inflation * burn_execution_error.new_sigma(tuning), tuning.burn_direction_sigma
        )
        motion = before, after, delta_v_N, covariance, reopened, tick_s
        joint, estimates = memory.joint, memory.estimates
        if joint is not None:
            joint = box_sharing.predict(tuning, settings.zonal_degree, joint, *motion)
        if estimates is not None:
            estimates = estimate_sharing.predict(tuning, settings.zonal_degree, estimates, *motion)
        return replace(_with_burns(memory, before, delta_v_N, covariance, tick_s), joint=joint, estimates=estimates)

    return batching_mode.transform()(of_one, in_axes=-1, out_axes=-1)(
        tuning, memory, before, after, delta_v_N, burn_delta_v, burn_sigma_inflation, reopened
    )


def _with_burns(
    memory: SharingMemory, before: OrbitEstimate, delta_v_N: Vector, covariance: Float[Array, "3 3"], dt: float
) -> SharingMemory:
    """Memory with the burn of a tick."""
    gradient = two_body_gravity.gravity_gradient(before.servicer.r_SN_N)
    return replace(memory, burns=burn_effect.advance(memory.burns, gradient, delta_v_N, covariance, dt))
