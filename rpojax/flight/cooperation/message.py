"""Messages between servicers: what each sends of itself and of the target, and the delay line they go through."""

from typing import Protocol, TypeVar, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from rpojax.core.pytree import pytree, replace
from rpojax.flight.cooperation.burn_effect import BurnEffect
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, GpsMeasurement


@runtime_checkable
class Stamped(Protocol):
    """A record with a time stamp."""

    @property
    def time(self) -> Array:
        """() since the start [s]."""
        ...


Sent = TypeVar("Sent", bound=Stamped)


@pytree
class TargetTrack:
    """The sender's estimate of the target relative to itself.

    Attributes:
        state: (6,) position [m] and velocity [m/s] in N
        covariance: (6, 6)
        correlated: (6, 6) part of it by errors that other servicers' estimates may have, too
    """

    state: Array
    covariance: Array
    correlated: Array


@pytree
class Message:
    """State of the sender at the time stamp.

    Attributes:
        time: () time stamp since the start [s], minus infinity before the first one
        gps: position, by code or carrier phase
        burns: effect of the sender's burns, at the start
        from_start: (6, 6) state transition matrix from the start to the time stamp
        q_KN: (4,) attitude of its camera
        attitude_variance: () sum of the changes of that attitude's variance since the start [rad^2]
        box: box that passed the sender's gate, None where boxes are not shared
        track: estimate of the target, None where estimates are not shared
        ranges: (peers,) ranges that it measured over the links [m], None if ranges are not measured; kept for
            itself
    """

    time: Array
    gps: GpsMeasurement
    burns: BurnEffect
    from_start: Array
    q_KN: Array
    attitude_variance: Array
    box: BoxMeasurement | None = None
    track: TargetTrack | None = None
    ranges: Array | None = None


def delay_line(message: Sent, delay_ticks: int) -> Sent:
    """Messages of the last ticks, newest first along a leading axis; none of them has been sent."""
    line = jax.tree.map(lambda leaf: jnp.stack([jnp.zeros_like(leaf)] * (delay_ticks + 1)), message)
    return replace(line, time=jnp.full_like(line.time, -jnp.inf))


def push(line: Sent, message: Sent) -> Sent:
    """Delay line one tick later, with a new message."""
    return jax.tree.map(lambda old, new: jnp.concatenate([new[None], old[:-1]]), line, message)


def oldest(line: Sent) -> Sent:
    """The message that arrives now."""
    return jax.tree.map(lambda leaf: leaf[-1], line)


def message_bytes(message: Message) -> int:
    """Length of a message of double-precision numbers and flags of one byte [byte].

    A covariance is sent as its upper triangle. What the receiver works out or measures itself is not sent.
    """
    covariances = [
        message.burns.covariance,
        *([] if message.track is None else [message.track.covariance, message.track.correlated]),
    ]
    total = -8 * sum(P.shape[0] * (P.shape[0] - 1) // 2 for P in covariances)
    for leaf in jax.tree.leaves(replace(message, ranges=None)):
        total += leaf.size * (1 if leaf.dtype == bool else 8)
    return total
