"""What the messages of one tick tell a servicer of each peer: their content, and what happened since those before."""

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.numerics import double_single
from rpojax.core.pytree import pytree
from rpojax.core.vectors import product
from rpojax.flight.cooperation import burn_effect
from rpojax.flight.cooperation.burn_effect import BurnEffect, BurnSum
from rpojax.flight.cooperation.message import Message
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning

T = TypeVar("T")


@pytree
class Heard:
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
class News:
    """Messages that a servicer may use in a tick; all have a leading axis of peers.

    Attributes:
        messages: the latest one of each peer
        used: (peers,) bool, it has arrived, and no later one before it
        interval: (peers,) since the time stamp before [s]
        burns: effect of the peer's burns in between, propagated to now, (peers, ...)
        attitude_variance: (peers,) change in between [rad^2]
        baseline: (peers, 3) GPS position of the peer less the own one, both at the time stamp [m]
        measured: (peers,) bool, there is one
        ranges: (peers,) ranges over the links at the time stamp [m], None without
        own_burns: (6,) effect of the own burns since the time stamp, propagated to now
        tuning: orbit filters of the peers
        focal_px: (peers,) of their cameras [px]
    """

    messages: Message
    used: Array
    interval: Array
    burns: BurnEffect
    attitude_variance: Array
    baseline: Array
    measured: Array
    own_burns: Array
    tuning: OrbitFilterTuning
    focal_px: Array
    ranges: Array | None = None


def initial(count: int) -> Heard:
    """Nothing heard of so many peers; the first message is one of a peer without burns."""
    return Heard(time=jnp.zeros(count), burns=_repeat(burn_effect.none(), count), attitude_variance=jnp.zeros(count))


def _repeat(effect: BurnEffect, count: int) -> BurnEffect:
    return jax.tree.map(lambda leaf: jnp.stack([leaf] * count), effect)


def read(
    heard: Heard,
    messages: Message,
    received: Bool[Array, " peers"],
    own_burns: BurnSum,
    own_then: Message,
    tuning: OrbitFilterTuning,
    focal_px: Float[Array, " peers"],
    forth: Float[Array, "6 6"] | None,
    time: Array,
) -> tuple[News, Heard]:
    """News of a tick, and the memory after it.

    Args:
        heard: memory of the servicer
        messages: of its peers
        received: (peers,) bool
        own_burns: effect of its own burns, now
        own_then: its own message of the time stamps
        tuning: of the peers
        focal_px: (peers,) of their cameras [px]
        forth: (6, 6) state transition matrix from the time stamps to now, None if they are now
        time: () since the start [s]
    """
    used = received & (messages.time >= heard.time)
    news = News(
        messages=messages,
        used=used,
        interval=jnp.where(used, messages.time - heard.time, 0.0),
        burns=_peer_burns(messages, heard, forth, time),
        attitude_variance=messages.attitude_variance - heard.attitude_variance,
        baseline=_gps_differences(messages, own_then),
        measured=used & messages.gps.present & own_then.gps.present,
        own_burns=burn_effect.change_since(own_burns.at_start, own_then.burns, own_burns.from_start),
        tuning=tuning,
        focal_px=focal_px,
        ranges=own_then.ranges,
    )
    latest = Heard(time=messages.time, burns=messages.burns, attitude_variance=messages.attitude_variance)
    return news, select_peers(used, latest, heard)


def _peer_burns(messages: Message, heard: Heard, forth: Float[Array, "6 6"] | None, time: Array) -> BurnEffect:
    """Effect of the peers' burns between what was heard before and the messages, propagated to now."""
    effects = []
    for k in range(heard.time.shape[0]):
        now, before = (jax.tree.map(lambda leaf, k=k: leaf[k], effect) for effect in (messages.burns, heard.burns))
        from_start = messages.from_start[k] if forth is None else product(forth, messages.from_start[k])
        effects.append(burn_effect.since(now, before, from_start, time))
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *effects)


def _gps_differences(messages: Message, own: Message) -> Float[Array, "peers 3"]:
    """GPS positions of the peers less the own one [m]."""
    count = messages.time.shape[0]
    differences = []
    for k in range(count):
        low = messages.gps.position_low_N
        differences.append(
            double_single.subtract(
                messages.gps.position_N[k],
                None if low is None else low[k],
                own.gps.position_N,
                own.gps.position_low_N,
            )
        )
    return jnp.stack(differences)


def select_peers(condition: Bool[Array, " peers"], if_true: T, if_false: T) -> T:
    """One of two pytrees for each peer, the leading axis of their arrays."""

    def choose(a: Array, b: Array) -> Array:
        return jnp.where(jnp.expand_dims(condition, tuple(range(1, a.ndim))), a, b)

    return jax.tree.map(choose, if_true, if_false)
