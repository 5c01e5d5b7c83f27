"""Reference governor: commands within the limit, unchanged deviations where they are, and convergence from far."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from numpy_reference import SEEDS

from rpojax.core.orbits.clohessy_wiltshire import transition_matrix
from rpojax.flight.control import reference_governor
from rpojax.flight.control.formation_law import lqr_feedback, lqr_gain
from rpojax.flight.flight_records import FlightParams

N, PERIOD = 1.1e-3, 200.0


@pytest.fixture(scope="module")
def gain(flight: FlightParams) -> jax.Array:
    return lqr_gain(flight.formation, jnp.float64(N), PERIOD)


@given(SEEDS)
def test_only_as_much_of_the_along_track_deviation_is_left_as_the_limit_allows(gain: jax.Array, seed: int) -> None:
    rng = np.random.default_rng(seed)
    deviation = np.concatenate([rng.normal(size=3) * [1.0, 100.0, 1.0], 1e-3 * rng.normal(size=3)])
    offset, limit = 1e-3 * rng.normal(size=3), rng.uniform(0.005, 0.05)
    found = np.asarray(reference_governor.govern(gain, jnp.asarray(deviation), jnp.asarray(offset), jnp.float64(limit)))
    share = found[1] / deviation[1]
    np.testing.assert_array_equal(np.delete(found, 1), np.delete(deviation, 1))
    assert 0.0 <= share <= 1.0

    def size(share: float) -> float:
        return float(np.linalg.norm(offset + lqr_feedback(gain, jnp.asarray(deviation).at[1].multiply(share))))

    shares = np.linspace(0.0, 1.0, 201)
    sizes = np.array([size(each) for each in shares])
    if sizes.min() > limit:
        np.testing.assert_allclose(size(share), sizes.min(), rtol=1e-3)
    else:
        assert size(share) <= limit * (1.0 + 1e-9)
        assert share >= shares[sizes <= limit].max() - 1e-9


def test_a_deviation_within_the_limit_is_unchanged(gain: jax.Array) -> None:
    deviation = np.array([0.1, -0.5, 0.2, 1e-4, 0.0, 1e-4])
    found = reference_governor.govern(gain, jnp.asarray(deviation), jnp.zeros(3), jnp.float64(0.05))
    np.testing.assert_array_equal(found, deviation)


def test_a_weak_thruster_arrives_from_far(gain: jax.Array) -> None:
    """150 m with a thruster that saturates at a tenth of the linear command, as which it would overshoot."""
    transition, limit = np.asarray(transition_matrix(jnp.float64(N), jnp.float64(PERIOD))), 0.02
    state = np.array([0.0, 150.0, 0.0, 0.0, 0.0, 0.0])
    assert np.linalg.norm(lqr_feedback(gain, jnp.asarray(state))) > 10.0 * limit
    farthest = 0.0
    for _ in range(60):
        governed = reference_governor.govern(gain, jnp.asarray(state), jnp.zeros(3), jnp.float64(limit))
        command = np.asarray(lqr_feedback(gain, governed))
        state[3:] += command * min(1.0, limit / max(float(np.linalg.norm(command)), 1e-12))
        state = transition @ state
        farthest = max(farthest, float(np.linalg.norm(state[[0, 2]])), -float(state[1]))
    assert np.linalg.norm(state[:3]) < 0.5
    assert farthest < 20.0
