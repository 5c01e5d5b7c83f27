"""Covariance propagation against the dense transition."""

import jax
import numpy as np
from hypothesis import given
from numpy_reference import SEEDS, random_covariance

from rpojax.flight.navigation import orbit_covariance

EXACT = 1e-13  # a few roundings relative to the standard deviations
propagate = jax.jit(orbit_covariance.propagate, static_argnums=5)
burning = jax.jit(
    lambda P, gradient, decay, velocity, growth, dt, effects: orbit_covariance.propagate(
        P, gradient, decay, velocity, growth, dt, [(6, effects[0]), (8, effects[1])]
    ),
    static_argnums=5,
)


@given(SEEDS)
def test_propagation_agrees_with_a_dense_kick_drift_and_decay(seed: int) -> None:
    rng = np.random.default_rng(seed)
    dt, n = 0.7, 1.0
    gradient = n * random_covariance(rng, np.ones(3))
    decay = rng.uniform(0.5, 1.0, 2)
    kick, drift, rest = np.eye(8), np.eye(8), np.diag(np.concatenate([np.ones(6), decay]))
    kick[3:6, :3] = dt * gradient
    drift[:3, 3:6] = dt * np.eye(3)
    F = rest @ drift @ kick
    P = random_covariance(rng, 10.0 ** rng.uniform(-2, 1, 8))
    velocity, growth = random_covariance(rng, 10.0 ** rng.uniform(-2, 1, 3)), rng.uniform(0.0, 3.0, 2)
    noise = np.zeros((8, 8))
    noise[3:6, 3:6], noise[6:, 6:] = velocity, np.diag(growth)
    found = np.asarray(propagate(P, gradient, decay, velocity, growth, dt))
    expected = F @ P @ F.T + noise
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=EXACT)
    symmetric = np.asarray(propagate(P + P.T, gradient + gradient.T, decay, velocity + velocity.T, growth, dt))
    np.testing.assert_array_equal(symmetric, symmetric.T)


def test_states_that_act_on_burns_add_to_position_and_velocity_as_a_dense_matrix_does() -> None:
    rng = np.random.default_rng(0)
    P, gradient, decay = random_covariance(rng, np.ones(9)), np.diag([2e-6, -1e-6, -1e-6]), np.full(3, 0.9)
    velocity, growth, dt = 1e-6 * np.eye(3), np.full(3, 1e-3), 0.7
    effects = rng.normal(size=(2, 3))
    shear = np.eye(9)
    for place, effect in zip((6, 8), effects, strict=True):
        shear[:6, place] = np.concatenate([0.5 * dt * effect, effect])
    quiet = 0.0 * velocity
    free = np.asarray(propagate(P, gradient, decay, quiet, growth, dt))
    found = np.asarray(burning(P, gradient, decay, velocity, growth, dt, effects))
    expected = shear @ free @ shear.T + np.pad(velocity, (3, 3))
    np.testing.assert_allclose(found, expected, atol=50 * EXACT)
    np.testing.assert_allclose(found, found.T, atol=EXACT)


def test_the_kick_and_drift_of_an_orbit_preserve_volume() -> None:
    gradient = 1e-6 * np.diag([2.0, -1.0, -1.0])
    P = np.asarray(propagate(np.eye(6), gradient, np.zeros(0), np.zeros((3, 3)), np.zeros(0), 1.0))
    np.testing.assert_allclose(np.linalg.det(P), 1.0, rtol=1e-12)
