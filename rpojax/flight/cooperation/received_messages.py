"""What the messages that a servicer receives in a tick tell of each peer, and of what it did since those before."""

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import double_single
from rpojax.core.orbits import gravity_gradient
from rpojax.core.pytree import pytree, replace
from rpojax.core.vectors import product
from rpojax.flight.cooperation import burn_effect
from rpojax.flight.cooperation.baseline_motion import transition_matrix
from rpojax.flight.cooperation.burn_effect import BurnEffect, BurnSum
from rpojax.flight.cooperation.message import Message
from rpojax.flight.cooperation.team_settings import ServicerTuning

T = TypeVar("T")


@pytree
class LastReceived:
    """What a servicer remembers of the latest message of each peer.

    Attributes:
        time: (peers,) its time stamp [s]
        burns: effect of the peer's burns, (peers, ...), at the start
        attitude_variance: (peers,) as the message had it [rad^2]
    """

    time: Array
    burns: BurnEffect
    attitude_variance: Array


@pytree
class Arrivals:
    """Messages of the peers that are due now, (peers, ...).

    Attributes:
        messages: of each peer
        arrived: (peers,) bool, whether it is received
        tuning: of the peers
    """

    messages: Message
    arrived: Array
    tuning: ServicerTuning


@pytree
class OwnThen:
    """A servicer at the time stamp of the messages that arrive now, and what leads from there to now.

    Attributes:
        message: its own message of that time
        burns: (6,) effect of its burns since, propagated to now
        to_now: (6, 6) state transition matrix from the time stamp to now, None if they are the same
        to_stamp: (6, 6) the one back, None likewise
    """

    message: Message
    burns: Array
    to_now: Array | None = None
    to_stamp: Array | None = None


@pytree
class ReceivedMessages:
    """Messages that a servicer may use in a tick; all but the own part have a leading axis of peers.

    Attributes:
        messages: the latest one of each peer
        used: (peers,) bool, it has arrived, and no later one before it
        interval: (peers,) since the time stamp before [s]
        burns: effect of the peer's burns in between, propagated to now, (peers, ...)
        attitude_variance: (peers,) change in between [rad^2]
        baseline: (peers, 3) GPS position of the peer less the own one, both at the time stamp [m]
        measured: (peers,) bool, there is one
        own: this servicer at the time stamp
        tuning: of the peers
        ranges: (peers,) ranges over the links at the time stamp [m], None if ranges are not measured
    """

    messages: Message
    used: Array
    interval: Array
    burns: BurnEffect
    attitude_variance: Array
    baseline: Array
    measured: Array
    own: OwnThen
    tuning: ServicerTuning
    ranges: Array | None = None


def of_peer(received: ReceivedMessages, peer: int) -> ReceivedMessages:
    """What is received of one peer, without the leading axis."""
    alone = jax.tree.map(lambda leaf: leaf[peer], replace(received, own=None))
    return replace(alone, own=received.own)


def initial(count: int) -> LastReceived:
    """Nothing received of `count` peers; the first message is one of a peer without burns."""
    burns = jax.tree.map(lambda leaf: jnp.stack([leaf] * count), burn_effect.none())
    return LastReceived(time=jnp.zeros(count), burns=burns, attitude_variance=jnp.zeros(count))


def own_then(message: Message, burns: BurnSum, r_SN_N: Float[Array, "3"], delay: float) -> OwnThen:
    """A servicer `delay` [s] ago, from its message of that time, and its burns and its position [m] now."""
    to_now, to_stamp = None, None
    if delay > 0.0:
        gradient = gravity_gradient.gravity_gradient(r_SN_N)
        to_now, to_stamp = transition_matrix(gradient, delay), transition_matrix(gradient, -delay)
    since = burn_effect.change_since(burns.at_start, message.burns, burns.from_start)
    return OwnThen(message=message, burns=since, to_now=to_now, to_stamp=to_stamp)


def read(last: LastReceived, arrivals: Arrivals, own: OwnThen, time: Array) -> tuple[ReceivedMessages, LastReceived]:
    """What a servicer receives in a tick at `time` [s] since the start, equal in all runs, and the memory after it."""
    messages = arrivals.messages
    used = arrivals.arrived & (messages.time >= last.time)
    received = ReceivedMessages(
        messages=messages,
        used=used,
        interval=jnp.where(used, messages.time - last.time, 0.0),
        burns=_peer_burns(messages, last, own.to_now, time),
        attitude_variance=messages.attitude_variance - last.attitude_variance,
        baseline=_gps_differences(messages, own.message),
        measured=used & messages.gps.present & own.message.gps.present,
        own=own,
        tuning=arrivals.tuning,
        ranges=own.message.ranges,
    )
    latest = LastReceived(time=messages.time, burns=messages.burns, attitude_variance=messages.attitude_variance)
    return received, select_peers(used, latest, last)


def _peer_burns(messages: Message, last: LastReceived, to_now: Float[Array, "6 6"] | None, time: Array) -> BurnEffect:
    """Effect of the peers' burns between the messages before and these, propagated to now."""
    effects = []
    for k in range(last.time.shape[0]):
        now, before = (jax.tree.map(lambda leaf, k=k: leaf[k], effect) for effect in (messages.burns, last.burns))
        from_start = messages.from_start[k] if to_now is None else product(to_now, messages.from_start[k])
        effects.append(burn_effect.since(now, before, from_start, time))
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *effects)


def _gps_differences(messages: Message, own: Message) -> Float[Array, "peers 3"]:
    """GPS positions of the peers less the own one [m]."""
    low, differences = messages.gps.position_low_N, []
    for k in range(messages.time.shape[0]):
        peer_low = None if low is None else low[k]
        position_N = messages.gps.position_N[k]
        differences.append(double_single.subtract(position_N, peer_low, own.gps.position_N, own.gps.position_low_N))
    return jnp.stack(differences)


def select_peers(condition: Bool[Array, " peers"], if_true: T, if_false: T) -> T:
    """One of two pytrees for each peer, the leading axis of their arrays."""

    def choose(a: Array, b: Array) -> Array:
        return jnp.where(jnp.expand_dims(condition, tuple(range(1, a.ndim))), a, b)

    return jax.tree.map(choose, if_true, if_false)
