"""Messages of three peers: one that is new, one that did not arrive, and one that is older than the last."""

import jax
import jax.numpy as jnp
import numpy as np
import rendezvous_scene
from numpy_reference import MU, random_covariance, unit
from scipy.linalg import expm

from rpojax.core.pytree import replace
from rpojax.flight.cooperation import received_messages
from rpojax.flight.cooperation.burn_effect import BurnEffect, BurnSum
from rpojax.flight.cooperation.message import Message
from rpojax.flight.cooperation.received_messages import Arrivals, LastReceived, ReceivedMessages
from rpojax.flight.cooperation.team_settings import ServicerTuning
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import GpsMeasurement

RNG = np.random.default_rng(0)
PEERS = 3
RECEIVED = np.array([True, False, True])
STAMPS, LAST_AT = np.array([100.0, 100.0, 80.0]), np.array([60.0, 90.0, 90.0])
USED = [True, False, False]
SIGMAS = np.array([*3 * [0.1], *3 * [1e-3]])


def effects(count: int) -> BurnEffect:
    return BurnEffect(
        change=jnp.asarray(RNG.normal(size=(count, 6))),
        covariance=jnp.asarray([random_covariance(RNG, SIGMAS) for _ in range(count)]),
    )


def message(time: np.ndarray, burns: BurnEffect, gps_present: np.ndarray, ranges: jax.Array | None = None) -> Message:
    """Messages with random content in arrays that begin like `time`."""
    shape = np.shape(time)
    return Message(
        time=jnp.asarray(time),
        gps=GpsMeasurement(
            position_N=jnp.asarray(7e6 + 100.0 * RNG.normal(size=(*shape, 3))), present=jnp.asarray(gps_present)
        ),
        burns=burns,
        from_start=jnp.asarray(np.eye(6) + 0.1 * RNG.normal(size=(*shape, 6, 6))),
        q_KN=jnp.zeros((*shape, 4)),
        attitude_variance=jnp.asarray(RNG.uniform(size=shape)),
        ranges=ranges,
    )


own_then = jax.jit(received_messages.own_then, static_argnums=3)


@jax.jit
def read(
    last: LastReceived, sent: Message, own_burns: BurnSum, own: Message, tuning: OrbitFilterTuning, to_now: jax.Array
) -> tuple[ReceivedMessages, LastReceived]:
    of_peers = ServicerTuning(filter=tuning, focal_px=jnp.full(PEERS, 700.0))
    arrivals = Arrivals(messages=sent, arrived=jnp.asarray(RECEIVED), tuning=of_peers)
    then = replace(received_messages.own_then(own, own_burns, jnp.zeros(3), 0.0), to_now=to_now)
    return received_messages.read(last, arrivals, then, jnp.asarray(103.0))


def test_a_servicer_at_the_time_stamp_is_as_far_away_as_the_delay() -> None:
    burns = jax.tree.map(lambda leaf: leaf[0], effects(1))
    still = BurnSum(at_start=burns, from_start=jnp.eye(6), to_start=jnp.eye(6))
    own = message(np.array(100.0), burns, np.array(True))
    r = rendezvous_scene.R_SN_N
    gradient = MU / np.linalg.norm(r) ** 3 * (3.0 * np.outer(unit(r), unit(r)) - np.eye(3))
    generator = np.block([[np.zeros((3, 3)), np.eye(3)], [gradient, np.zeros((3, 3))]])
    then = own_then(own, still, r, 20.0)
    np.testing.assert_allclose(then.to_now, expm(20.0 * generator), atol=3e-7)
    np.testing.assert_allclose(then.to_stamp, expm(-20.0 * generator), atol=3e-7)
    now = own_then(own, still, r, 0.0)
    assert (now.to_now, now.to_stamp) == (None, None)


def test_what_is_received_is_what_changed_since_the_last_message_that_arrived(flight: FlightParams) -> None:
    last = LastReceived(time=jnp.asarray(LAST_AT), burns=effects(PEERS), attitude_variance=jnp.asarray([0.1, 0.2, 0.3]))
    sent = message(STAMPS, effects(PEERS), np.array([True, True, True]))
    first = jax.tree.map(lambda leaf: leaf[0], effects(1))
    own = message(np.array(100.0), first, np.array(True), ranges=jnp.asarray([30.0, 40.0, 50.0]))
    own_burns = BurnSum(
        at_start=jax.tree.map(lambda leaf: leaf[0], effects(1)),
        from_start=jnp.asarray(np.eye(6) + 0.1 * RNG.normal(size=(6, 6))),
        to_start=jnp.eye(6),
    )
    to_now = expm(0.1 * RNG.normal(size=(6, 6)))
    received, after = read(last, sent, own_burns, own, flight.navigation, jnp.asarray(to_now))

    np.testing.assert_array_equal(received.used, USED)
    np.testing.assert_array_equal(received.interval, [40.0, 0.0, 0.0])
    np.testing.assert_array_equal(received.measured, USED)
    np.testing.assert_array_equal(received.ranges, [30.0, 40.0, 50.0])
    np.testing.assert_array_equal(received.baseline, np.subtract(sent.gps.position_N, own.gps.position_N))
    variance = np.asarray(sent.attitude_variance) - np.asarray(last.attitude_variance)
    np.testing.assert_allclose(received.attitude_variance, variance, rtol=1e-14)
    own_change = own_burns.from_start @ (own_burns.at_start.change - own.burns.change)
    np.testing.assert_allclose(received.own.burns, own_change, rtol=1e-12, atol=1e-12)
    for k in range(PEERS):
        flow = to_now @ np.asarray(sent.from_start[k])
        change = np.asarray(sent.burns.change[k] - last.burns.change[k])
        covariance = np.asarray(sent.burns.covariance[k] - last.burns.covariance[k])
        np.testing.assert_allclose(received.burns.change[k], flow @ change, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(received.burns.covariance[k], flow @ covariance @ flow.T, rtol=1e-9, atol=1e-12)
        # Remembered is the last one that was used.
        kept = sent if USED[k] else last
        assert float(after.time[k]) == float(kept.time[k])
        assert float(after.attitude_variance[k]) == float(kept.attitude_variance[k])
        np.testing.assert_array_equal(after.burns.covariance[k], kept.burns.covariance[k])


def test_a_baseline_is_measured_if_both_have_a_gps_position(flight: FlightParams) -> None:
    nothing = received_messages.initial(PEERS)
    np.testing.assert_array_equal(nothing.time, np.zeros(PEERS))
    burns = jax.tree.map(lambda leaf: leaf[0], effects(1))
    still = BurnSum(at_start=burns, from_start=jnp.eye(6), to_start=jnp.eye(6))
    sent = message(STAMPS, effects(PEERS), np.array([True, True, False]))
    for own_present in (True, False):
        own = message(np.array(100.0), burns, np.array(own_present), ranges=jnp.zeros(PEERS))
        received, _ = read(nothing, sent, still, own, flight.navigation, jnp.eye(6))
        np.testing.assert_array_equal(received.used, RECEIVED)
        np.testing.assert_array_equal(received.measured, [own_present, False, False])
        np.testing.assert_array_equal(received.own.burns, np.zeros(6))
