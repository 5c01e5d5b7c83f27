"""Messages: delay line, length, and what burns did between two that arrived."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.orbits import gravity_gradient
from rpojax.flight.cooperation import baseline_motion, burn_effect, message
from rpojax.flight.cooperation.burn_effect import BurnSum
from rpojax.flight.cooperation.message import Message, TargetTrack
from rpojax.flight.navigation.orbit_measurements import GpsMeasurement

R_N = jnp.array([6.9e6, 1e5, -3e5])


gradient_at = jax.jit(gravity_gradient.gravity_gradient)
transition_matrix = jax.jit(baseline_motion.transition_matrix)
advance = jax.jit(burn_effect.advance, static_argnums=4)
since = jax.jit(burn_effect.since)
push = jax.jit(message.push)


@jax.jit
def message_at(time: jax.Array | float) -> Message:
    return Message(
        time=jnp.asarray(time),
        gps=GpsMeasurement(position_N=jnp.zeros(3), present=jnp.asarray(True)),
        burns=burn_effect.none(),
        from_start=jnp.eye(6),
        q_KN=jnp.array([1.0, 0.0, 0.0, 0.0]),
        attitude_variance=jnp.zeros(()),
        track=TargetTrack(state=jnp.zeros(6), covariance=jnp.eye(6), correlated=jnp.eye(6)),
    )


def test_messages_arrive_in_their_order_after_the_delay() -> None:
    line = message.delay_line(message_at(0.0), 2)
    arrived = []
    for tick in range(5):
        line = push(line, message_at(float(tick)))
        arrived.append(float(message.oldest(line).time))
    assert arrived == [-np.inf, -np.inf, 0.0, 1.0, 2.0]


def test_bytes_of_a_message() -> None:
    # Time, GPS with its flag, burns with half a covariance and the transition matrix, attitude, its variance, track
    # with two halves of covariances.
    assert message.message_bytes(message_at(0.0)) == 8 + 25 + 8 * (6 + 21 + 36) + 32 + 8 + 8 * (6 + 21 + 21)


@pytest.mark.parametrize("t", [-20.0, 7.0, 20.0])
def test_free_motion_is_the_exponential(t: float) -> None:
    G = gradient_at(R_N)
    steps = np.eye(6)
    for _ in range(2000):
        steps = np.asarray(transition_matrix(G, t / 2000)) @ steps
    np.testing.assert_allclose(transition_matrix(G, t), steps, atol=3e-7)


def test_burns_of_lost_messages_are_known_from_the_next_one() -> None:
    gradient = gradient_at(R_N)
    phi = np.asarray(transition_matrix(gradient, 1.0))
    burns, before = burn_effect.initial(), burn_effect.none()
    expected, P = np.zeros(6), np.zeros((6, 6))
    rng = np.random.default_rng(0)
    for tick in range(60):
        delta_v, Q = np.zeros(3), np.zeros((3, 3))
        if tick % 7 == 0:
            delta_v, Q = rng.normal(size=3), 0.01 * np.diag(rng.uniform(size=3))
        burns = advance(burns, gradient, delta_v, Q, 1.0)
        expected = phi @ expected + np.concatenate([0.5 * delta_v, delta_v])
        P = phi @ P @ phi.T
        P[3:, 3:] += Q
        if tick == 20:
            before, expected, P = burns.at_start, np.zeros(6), np.zeros((6, 6))
    found = since(burns.at_start, before, burns.from_start, jnp.asarray(40.0))
    np.testing.assert_allclose(found.change, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.covariance, P, atol=1e-9)


def test_what_burns_added_is_a_covariance_however_long_ago_the_first_was() -> None:
    # After hours of burns whose errors have spread to kilometres, the little that the last one added must not be less
    # than nothing by rounding or by a gradient of another place.
    Q = jnp.asarray(np.diag([1e-6, 4e-6, 2e-6]))

    def step(burns: BurnSum, tick: jax.Array) -> tuple[BurnSum, None]:
        angle, burn = 1.1e-2 * tick, jnp.where(tick % 100.0 == 99.0, 1.0, 0.0)
        r_N = 6.9e6 * jnp.stack([jnp.cos(angle), jnp.sin(angle), 0.0 * angle])
        gradient = gravity_gradient.gravity_gradient(r_N)
        return burn_effect.advance(burns, gradient, 0.01 * burn * jnp.ones(3), burn * Q, 10.0), None

    run = jax.jit(lambda burns, ticks: jax.lax.scan(step, burns, ticks)[0])
    before = run(burn_effect.initial(), np.arange(3999.0))
    after = run(before, np.arange(3999.0, 4000.0))
    found = since(after.at_start, before.at_start, after.from_start, jnp.asarray(4e4))
    assert np.linalg.eigvalsh(after.at_start.covariance)[-1] > 1e6
    # Of steps of 10 s, the transition there and back differs from one by a thousandth after seven orbits.
    np.testing.assert_allclose(found.covariance[3:, 3:], Q, atol=5e-9)
    # Sums of kilometres squared, rounded to parts in 1e16 and mapped over seven orbits: millimetres of position.
    assert np.linalg.eigvalsh(found.covariance)[0] > -(5e-3**2)
