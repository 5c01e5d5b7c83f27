"""Covariance propagation against the dense transition."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from numpy_reference import SEEDS, random_covariance, random_unit

from rpojax.core.orbits import gravity_gradient
from rpojax.core.pytree import replace
from rpojax.flight.navigation import orbit_covariance
from rpojax.flight.navigation.orbit_covariance import OrbitStep

EXACT = 1e-13  # a few roundings relative to the standard deviations
R_SN_N = np.array([4e6, -3e6, 4.7e6])
PLACES = (7, 8)
"""Of the slow states that act on the motion: the last ones."""


@jax.jit
def propagate(
    P: jax.Array,
    step: OrbitStep,
    decay: jax.Array,
    growth: jax.Array,
    effects: jax.Array | None = None,
) -> jax.Array:
    acting = replace(step, velocity_effects=None if effects is None else effects.T)
    return orbit_covariance.propagate(P, acting, decay, growth)


def step_of(dt: float, velocity: np.ndarray, r_SN_N: np.ndarray = R_SN_N) -> OrbitStep:
    return OrbitStep(dt=dt, r_SN_N=r_SN_N, velocity_covariance=velocity)


@given(SEEDS)
def test_propagation_agrees_with_a_dense_kick_drift_and_decay(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # So near to the centre that the kick is as large as the rest.
    dt, r_SN_N = 0.7, 6e4 * random_unit(rng, 3)
    gradient = np.asarray(gravity_gradient.gravity_gradient(jnp.asarray(r_SN_N)))
    assert 0.5 < np.max(np.abs(gradient)) < 5.0
    decay = rng.uniform(0.5, 1.0, 2)
    kick, drift, rest = np.eye(8), np.eye(8), np.diag(np.concatenate([np.ones(6), decay]))
    kick[3:6, :3] = dt * gradient
    drift[:3, 3:6] = dt * np.eye(3)
    F = rest @ drift @ kick
    P = random_covariance(rng, 10.0 ** rng.uniform(-2, 1, 8))
    velocity, growth = random_covariance(rng, 10.0 ** rng.uniform(-2, 1, 3)), rng.uniform(0.0, 3.0, 2)
    noise = np.zeros((8, 8))
    noise[3:6, 3:6], noise[6:, 6:] = velocity, np.diag(growth)
    found = np.asarray(propagate(P, step_of(dt, velocity, r_SN_N), decay, growth))
    expected = F @ P @ F.T + noise
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=EXACT)
    symmetric = np.asarray(propagate(P + P.T, step_of(dt, velocity + velocity.T, r_SN_N), decay, growth))
    np.testing.assert_array_equal(symmetric, symmetric.T)


def test_states_that_act_on_the_motion_add_to_position_and_velocity_as_a_dense_matrix_does() -> None:
    rng = np.random.default_rng(0)
    P, decay = random_covariance(rng, np.ones(9)), np.full(3, 0.9)
    velocity, growth, dt = 1e-6 * np.eye(3), np.full(3, 1e-3), 0.7
    effects = rng.normal(size=(2, 3))
    shear = np.eye(9)
    for place, effect in zip(PLACES, effects, strict=True):
        shear[:6, place] = np.concatenate([0.5 * dt * effect, effect])
    quiet = 0.0 * velocity
    free = np.asarray(propagate(P, step_of(dt, quiet), decay, growth))
    found = np.asarray(propagate(P, step_of(dt, velocity), decay, growth, effects))
    expected = shear @ free @ shear.T + np.pad(velocity, (3, 3))
    np.testing.assert_allclose(found, expected, atol=50 * EXACT)
    np.testing.assert_allclose(found, found.T, atol=EXACT)


def test_the_kick_and_drift_of_an_orbit_preserve_volume() -> None:
    P = np.asarray(propagate(np.eye(6), step_of(1.0, np.zeros((3, 3))), np.zeros(0), np.zeros(0)))
    np.testing.assert_allclose(np.linalg.det(P), 1.0, rtol=1e-12)
