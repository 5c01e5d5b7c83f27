"""News of messages of three peers: one that is new, one that did not arrive, and one that is older than the last."""

import jax
import jax.numpy as jnp
import numpy as np
from numpy_reference import random_covariance
from scipy.linalg import expm

from rpojax.flight.cooperation import peer_news
from rpojax.flight.cooperation.burn_effect import BurnEffect, BurnSum
from rpojax.flight.cooperation.message import Message
from rpojax.flight.cooperation.peer_news import Heard, News
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import GpsMeasurement

RNG = np.random.default_rng(0)
PEERS = 3
RECEIVED = np.array([True, False, True])
STAMPS, HEARD_AT = np.array([100.0, 100.0, 80.0]), np.array([60.0, 90.0, 90.0])
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


@jax.jit
def read(
    heard: Heard, sent: Message, own_burns: BurnSum, own: Message, tuning: OrbitFilterTuning, forth: jax.Array
) -> tuple[News, Heard]:
    focal_px = jnp.full(PEERS, 700.0)
    return peer_news.read(
        heard, sent, jnp.asarray(RECEIVED), own_burns, own, tuning, focal_px, forth, jnp.asarray(103.0)
    )


def test_news_is_what_changed_since_the_last_message_that_arrived(flight: FlightParams) -> None:
    heard = Heard(time=jnp.asarray(HEARD_AT), burns=effects(PEERS), attitude_variance=jnp.asarray([0.1, 0.2, 0.3]))
    sent = message(STAMPS, effects(PEERS), np.array([True, True, True]))
    first = jax.tree.map(lambda leaf: leaf[0], effects(1))
    own = message(np.array(100.0), first, np.array(True), ranges=jnp.asarray([30.0, 40.0, 50.0]))
    own_burns = BurnSum(
        at_start=jax.tree.map(lambda leaf: leaf[0], effects(1)),
        from_start=jnp.asarray(np.eye(6) + 0.1 * RNG.normal(size=(6, 6))),
        to_start=jnp.eye(6),
    )
    forth = expm(0.1 * RNG.normal(size=(6, 6)))
    news, after = read(heard, sent, own_burns, own, flight.navigation, jnp.asarray(forth))

    np.testing.assert_array_equal(news.used, USED)
    np.testing.assert_array_equal(news.interval, [40.0, 0.0, 0.0])
    np.testing.assert_array_equal(news.measured, USED)
    np.testing.assert_array_equal(news.ranges, [30.0, 40.0, 50.0])
    np.testing.assert_array_equal(news.baseline, np.subtract(sent.gps.position_N, own.gps.position_N))
    variance = np.asarray(sent.attitude_variance) - np.asarray(heard.attitude_variance)
    np.testing.assert_allclose(news.attitude_variance, variance, rtol=1e-14)
    own_change = own_burns.from_start @ (own_burns.at_start.change - own.burns.change)
    np.testing.assert_allclose(news.own_burns, own_change, rtol=1e-12, atol=1e-12)
    for k in range(PEERS):
        flow = forth @ np.asarray(sent.from_start[k])
        change = np.asarray(sent.burns.change[k] - heard.burns.change[k])
        covariance = np.asarray(sent.burns.covariance[k] - heard.burns.covariance[k])
        np.testing.assert_allclose(news.burns.change[k], flow @ change, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(news.burns.covariance[k], flow @ covariance @ flow.T, rtol=1e-9, atol=1e-12)
        # Remembered is the last one that was used.
        kept = sent if USED[k] else heard
        assert float(after.time[k]) == float(kept.time[k])
        assert float(after.attitude_variance[k]) == float(kept.attitude_variance[k])
        np.testing.assert_array_equal(after.burns.covariance[k], kept.burns.covariance[k])


def test_a_baseline_is_measured_if_both_have_a_gps_position(flight: FlightParams) -> None:
    nothing = peer_news.initial(PEERS)
    np.testing.assert_array_equal(nothing.time, np.zeros(PEERS))
    burns = jax.tree.map(lambda leaf: leaf[0], effects(1))
    still = BurnSum(at_start=burns, from_start=jnp.eye(6), to_start=jnp.eye(6))
    sent = message(STAMPS, effects(PEERS), np.array([True, True, False]))
    for own_present in (True, False):
        own = message(np.array(100.0), burns, np.array(own_present), ranges=jnp.zeros(PEERS))
        news, _ = read(nothing, sent, still, own, flight.navigation, jnp.eye(6))
        np.testing.assert_array_equal(news.used, RECEIVED)
        np.testing.assert_array_equal(news.measured, [own_present, False, False])
        np.testing.assert_array_equal(news.own_burns, np.zeros(6))
