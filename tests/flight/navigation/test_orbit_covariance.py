"""Covariance propagation against the dense transition."""

import jax
import numpy as np
from hypothesis import given
from numpy_reference import SEEDS, random_covariance

from rpojax.flight.navigation import orbit_covariance

EXACT = 1e-13  # a few roundings relative to the standard deviations
propagate = jax.jit(orbit_covariance.propagate, static_argnums=5)


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


def test_an_error_common_to_burns_adds_its_outer_product_and_the_transposed_one() -> None:
    rng = np.random.default_rng(0)
    P, gradient, decay = random_covariance(rng, np.ones(9)), np.diag([2e-6, -1e-6, -1e-6]), np.full(3, 0.9)
    velocity, growth = 1e-6 * np.eye(3), np.full(3, 1e-3)
    g, u = rng.normal(size=6), rng.normal(size=9)
    without = np.asarray(propagate(P, gradient, decay, velocity, growth, 1.0))
    found = np.asarray(propagate(P, gradient, decay, velocity, growth, 1.0, (g, u)))
    added = np.outer(np.concatenate([g, np.zeros(3)]), u)
    np.testing.assert_allclose(found - without, added + added.T, atol=EXACT)
    # To the last bit where no rounding of the free motion is in the way.
    alone = np.asarray(propagate(np.zeros((9, 9)), 0.0 * gradient, decay, 0.0 * velocity, 0.0 * growth, 1.0, (g, u)))
    np.testing.assert_array_equal(alone, alone.T)


def test_the_kick_and_drift_of_an_orbit_preserve_volume() -> None:
    gradient = 1e-6 * np.diag([2.0, -1.0, -1.0])
    P = np.asarray(propagate(np.eye(6), gradient, np.zeros(0), np.zeros((3, 3)), np.zeros(0), 1.0))
    np.testing.assert_allclose(np.linalg.det(P), 1.0, rtol=1e-12)
