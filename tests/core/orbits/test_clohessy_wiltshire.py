"""Clohessy-Wiltshire motion against the matrix exponential of its differential equations."""

import jax
import numpy as np
import pytest
from free_drift_reference import least_drift_distance
from hypothesis import given
from numpy_reference import SEEDS
from scipy.linalg import expm

from rpojax.core.orbits import clohessy_wiltshire

transition_matrix = jax.jit(clohessy_wiltshire.transition_matrix)


@pytest.mark.parametrize("seconds", [0.0, 1.0, 200.0, 3000.0])
def test_the_transition_matrix_is_the_exponential_of_the_clohessy_wiltshire_equations(seconds: float) -> None:
    n = 1.1e-3
    A = np.zeros((6, 6))
    A[:3, 3:] = np.eye(3)
    A[3, 0], A[5, 2], A[3, 4], A[4, 3] = 3 * n * n, -n * n, 2 * n, -2 * n
    np.testing.assert_allclose(transition_matrix(np.float64(n), np.float64(seconds)), expm(A * seconds), atol=1e-8,
                               rtol=1e-9)  # fmt: skip


MEAN_MOTION = 1.107e-3
"""At 500 km [rad/s]."""

minimum_drift_distance = jax.jit(clohessy_wiltshire.minimum_drift_distance)


@given(SEEDS)
def test_the_minimum_drift_distance_is_that_of_the_propagated_equations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = MEAN_MOTION * rng.uniform(0.5, 1.5)
    state = np.concatenate([rng.uniform(-50.0, 50.0, 3), 0.03 * rng.normal(size=3)])
    found = float(minimum_drift_distance(n, state[:3], state[3:]))
    np.testing.assert_allclose(found, least_drift_distance(n, state, 72), rtol=1e-9)  # the same 73 points
    # The path between two points five degrees apart bounds the error.
    finest = least_drift_distance(n, state, 2880)
    speed = np.linalg.norm(state[3:]) + 4.0 * n * np.linalg.norm(state[:3])
    assert finest <= found + 1e-9
    assert found - finest < 6.0 * speed * np.deg2rad(2.5) / n


@pytest.mark.parametrize(
    ("rho", "rho_dot", "closest", "tolerance"),
    [
        ([0.0, -30.0, 0.0], [0.0, 0.0, 0.0], 30.0, 1e-9),  # at rest on the orbit
        ([0.0, -30.0, 0.0], [0.0, 0.0, 0.02], 30.0, 1e-9),  # oscillation across the orbit
        # A drift of 20 m per orbit, 3 v T, with its extremum where cos(n t) = 3/4.
        ([0.0, -40.0, 0.0], [0.0, -20.0 / (6.0 * np.pi) * MEAN_MOTION, 0.0], 19.5008, 1e-4),
    ],
)
def test_minimum_drift_distances_of_known_drifts(
    rho: list[float], rho_dot: list[float], closest: float, tolerance: float
) -> None:
    np.testing.assert_allclose(
        minimum_drift_distance(MEAN_MOTION, np.array(rho), np.array(rho_dot)), closest, rtol=tolerance
    )
