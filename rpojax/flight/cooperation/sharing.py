"""Exchange of messages between the servicers of a team, and what their filters make of it.

All records have the servicers along the last axis; each servicer's part is a function of its own records and of the
messages that it received.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.batching import batching_mode
from rpojax.core.numerics import double_single
from rpojax.core.pytree import pytree, replace
from rpojax.flight.cooperation import (
    box_sharing,
    burn_effect,
    estimate_sharing,
    joint_filter,
    message,
    received_messages,
)
from rpojax.flight.cooperation.baseline_motion import TickMotion
from rpojax.flight.cooperation.burn_effect import BurnSum
from rpojax.flight.cooperation.estimate_sharing import EstimateSharing
from rpojax.flight.cooperation.joint_filter import JointEstimate
from rpojax.flight.cooperation.message import Message, TargetTrack
from rpojax.flight.cooperation.received_messages import Arrivals, LastReceived, ReceivedMessages
from rpojax.flight.cooperation.team_records import TeamRecords, for_receivers
from rpojax.flight.cooperation.team_settings import Link, ServicerTuning
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate

Scalar = Float[Array, ""]


@pytree
class SharingMemory:
    """Memory of one servicer, or of all along the last axis.

    Attributes:
        line: its messages of the last ticks, newest first along the first axis
        burns: sum of the effects of its burns
        attitude_variance: () sum of the changes of its attitude's variance [rad^2]
        last_received: of its peers
        messages_used: (peers,) bool, what the peer sent was used in the latest tick
        joint: joint estimate, None unless boxes are shared
        estimates: of the target and the baselines, None unless estimates are shared
    """

    line: Message
    burns: BurnSum
    attitude_variance: Array
    last_received: LastReceived
    messages_used: Array
    joint: JointEstimate | None = None
    estimates: EstimateSharing | None = None


def initial(link: Link, tuning: ServicerTuning, records: TeamRecords) -> SharingMemory:
    """Memory at hand-over, from the records of all servicers, of which only the orbits count."""
    settings = link.settings
    peers = for_receivers((tuning.filter, records.orbit), settings.peers)

    def of_servicer(
        tuning: ServicerTuning, peers: tuple[OrbitFilterTuning, OrbitEstimate], records: TeamRecords
    ) -> SharingMemory:
        peer_tuning, peer_orbits = peers
        own, baselines = records.orbit.relative, _baselines(records.orbit, peer_orbits)
        zero, burns = jnp.zeros_like(own.r_TS_N[0]), burn_effect.initial()
        track = None if settings.shares_boxes else estimate_sharing.target_track(own, own.covariance)
        first = _message(records, burns, zero, track, zero)
        memory = SharingMemory(
            line=message.delay_line(first, settings.delay_ticks),
            burns=burns,
            attitude_variance=zero,
            last_received=received_messages.initial(settings.servicers - 1),
            messages_used=jnp.zeros(settings.servicers - 1, dtype=bool),
        )
        if settings.shares_boxes:
            joint = joint_filter.initial(link, tuning.filter, peer_tuning, own, baselines)
            return replace(memory, joint=joint)
        estimates = estimate_sharing.initial(link, tuning.filter, peer_tuning, own, baselines)
        return replace(memory, estimates=estimates)

    return batching_mode.transform()(of_servicer, in_axes=-1, out_axes=-1)(tuning, peers, records)


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
    records: TeamRecords, burns: BurnSum, attitude_variance: Scalar, track: TargetTrack | None, time: Scalar
) -> Message:
    """Message of one servicer, with the box unless it has an estimate of the target."""
    return Message(
        time=time,
        gps=records.gps,
        burns=burns.at_start,
        from_start=burns.from_start,
        q_KN=records.q_KN,
        attitude_variance=attitude_variance,
        box=records.gated_box if track is None else None,
        track=track,
        ranges=records.ranges,
    )


def share(
    link: Link,
    tuning: ServicerTuning,
    records: TeamRecords,
    memory: SharingMemory,
    arrived: Bool[Array, "peers N"],
    time: Scalar,
) -> tuple[TeamRecords, SharingMemory]:
    """Records and memory after own boxes and messages of a tick.

    Args:
        link: what is the same for all
        tuning: of the servicers, (..., N)
        records: after navigation
        memory: of the tick before
        arrived: (peers, N) bool, whether each receives what is due now of each of its peers
        time: () since the start [s]
    """

    def send(tuning: ServicerTuning, records: TeamRecords, memory: SharingMemory) -> SharingMemory:
        return _sent(link, tuning, records, memory, time)

    memory = batching_mode.transform()(send, in_axes=-1, out_axes=-1)(tuning, records, memory)
    messages, peer_tuning = for_receivers((message.oldest(memory.line), tuning), link.settings.peers)
    arrivals = Arrivals(messages=messages, arrived=arrived, tuning=peer_tuning)

    def receive(
        tuning: ServicerTuning, records: TeamRecords, memory: SharingMemory, arrivals: Arrivals
    ) -> tuple[RelativeEstimate, SharingMemory]:
        # What a failed sender would say may not be a number.
        none = jax.tree.map(jnp.zeros_like, arrivals.messages)
        messages = received_messages.select_peers(arrivals.arrived, arrivals.messages, none)
        r_SN_N = records.orbit.servicer.r_SN_N
        own = received_messages.own_then(message.oldest(memory.line), memory.burns, r_SN_N, link.delay)
        arrivals = replace(arrivals, messages=messages)
        received, latest = received_messages.read(memory.last_received, arrivals, own, time)
        return _received(link, tuning, records, replace(memory, last_received=latest), received)

    relative, memory = batching_mode.transform()(receive, in_axes=-1, out_axes=-1)(tuning, records, memory, arrivals)
    return replace(records, orbit=replace(records.orbit, relative=relative)), memory


def _sent(
    link: Link, tuning: ServicerTuning, records: TeamRecords, memory: SharingMemory, time: Scalar
) -> SharingMemory:
    """Memory of a servicer after the message of a tick."""
    track, estimates, own = None, memory.estimates, records.orbit.relative
    if link.settings.sharing == "estimates":
        assert estimates is not None
        estimates = estimate_sharing.update(tuning, estimates, records)
        assert estimates.local is not None
        assert estimates.correlated is not None
        track = estimate_sharing.target_track(estimates.local, estimates.correlated)
    elif link.settings.sharing == "naive":
        track = estimate_sharing.target_track(own, own.covariance)
    attitude_variance = memory.attitude_variance + records.box.attitude_variance_change
    new = _message(records, memory.burns, attitude_variance, track, time)
    return replace(
        memory, line=message.push(memory.line, new), attitude_variance=attitude_variance, estimates=estimates
    )


def _received(
    link: Link, tuning: ServicerTuning, records: TeamRecords, memory: SharingMemory, received: ReceivedMessages
) -> tuple[RelativeEstimate, SharingMemory]:
    """Estimate of the target and memory of a servicer after the messages of a tick."""
    if memory.joint is not None:
        joint, is_used = box_sharing.update(link.baseline, tuning, memory.joint, records, received)
        return joint_filter.own_estimate(joint), replace(memory, joint=joint, messages_used=is_used)
    assert memory.estimates is not None
    if link.settings.sharing == "naive":
        own = records.orbit.relative
        estimates, relative = estimate_sharing.receive_naively(link.baseline, memory.estimates, own, received)
    else:
        estimates, relative = estimate_sharing.receive(link.baseline, memory.estimates, received)
    return relative, replace(memory, estimates=estimates, messages_used=received.used)


def predict(
    link: Link, tuning: ServicerTuning, memory: SharingMemory, target: RelativeEstimate, motion: TickMotion
) -> SharingMemory:
    """Memory of all servicers one tick later, with their own estimates of the target then; all (..., N)."""

    def of_servicer(
        tuning: ServicerTuning, memory: SharingMemory, target: RelativeEstimate, motion: TickMotion
    ) -> SharingMemory:
        joint, estimates = memory.joint, memory.estimates
        if joint is not None:
            joint = box_sharing.predict(link, tuning.filter, joint, target, motion)
        if estimates is not None:
            estimates = estimate_sharing.predict(link, tuning.filter, estimates, motion)
        burns = burn_effect.advance(
            memory.burns, motion.gravity_gradient, motion.delta_v_N, motion.burn_covariance, link.tick_s
        )
        return replace(memory, burns=burns, joint=joint, estimates=estimates)

    return batching_mode.transform()(of_servicer, in_axes=-1, out_axes=-1)(tuning, memory, target, motion)
