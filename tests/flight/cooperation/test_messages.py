"""Messages: delay line, length, and what burns did between two that arrived."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.orbits import two_body_gravity
from rpojax.flight.cooperation import burn_effect, free_relative_motion, message
from rpojax.flight.cooperation.message import Message, TargetTrack
from rpojax.flight.navigation.orbit_measurements import GpsMeasurement

R_N = jnp.array([6.9e6, 1e5, -3e5])


def message_at(time: float) -> Message:
    return Message(
        time=jnp.asarray(time),
        gps=GpsMeasurement(position_N=jnp.zeros(3), present=jnp.asarray(True)),
        burns=burn_effect.initial(),
        q_KN=jnp.array([1.0, 0.0, 0.0, 0.0]),
        attitude_variance=jnp.zeros(()),
        track=TargetTrack(state=jnp.zeros(6), covariance=jnp.eye(6)),
    )


def test_messages_arrive_in_their_order_after_the_delay() -> None:
    line = message.delay_line(message_at(0.0), 2)
    arrived = []
    for tick in range(5):
        line = message.push(line, message_at(float(tick)))
        arrived.append(float(message.oldest(line).time))
    assert arrived == [-np.inf, -np.inf, 0.0, 1.0, 2.0]


def test_bytes_of_a_message() -> None:
    # Time, GPS with its flag, burns with half a covariance, attitude, its variance, track with half a covariance.
    assert message.message_bytes(message_at(0.0)) == 8 + 25 + 8 * (6 + 21) + 32 + 8 + 8 * (6 + 21)


@pytest.mark.parametrize("t", [-20.0, 7.0, 20.0])
def test_free_motion_is_the_exponential(t: float) -> None:
    G = two_body_gravity.gravity_gradient(R_N)
    steps = np.eye(6)
    for _ in range(2000):
        steps = np.asarray(free_relative_motion.transition_matrix(G, t / 2000)) @ steps
    np.testing.assert_allclose(free_relative_motion.transition_matrix(G, t), steps, atol=3e-7)


def test_burns_of_lost_messages_are_known_from_the_next_one() -> None:
    phi = free_relative_motion.transition_matrix(two_body_gravity.gravity_gradient(R_N), 1.0)
    effect, heard = burn_effect.initial(), burn_effect.initial()
    expected, P = np.zeros(6), np.zeros((6, 6))
    rng = np.random.default_rng(0)
    for tick in range(60):
        effect, heard = burn_effect.propagate(effect, phi), burn_effect.propagate(heard, phi)
        expected, P = np.asarray(phi) @ expected, np.asarray(phi) @ P @ np.asarray(phi).T
        if tick % 7 == 0:
            delta_v, Q = rng.normal(size=3), 0.01 * np.diag(rng.uniform(size=3))
            effect = burn_effect.burn(effect, jnp.asarray(delta_v), jnp.asarray(Q), 1.0)
            expected += np.concatenate([0.5 * delta_v, delta_v])
            P[3:, 3:] += Q
        if tick == 20:
            heard, expected, P = effect, np.zeros(6), np.zeros((6, 6))
    news = burn_effect.since(effect, heard)
    np.testing.assert_allclose(news.change, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(news.covariance, P, atol=1e-9)
