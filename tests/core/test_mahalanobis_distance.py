"""Mahalanobis distance and log-determinant against numpy."""

import jax
import numpy as np
import pytest
from hypothesis import given
from numpy_reference import SEEDS, random_covariance

from rpojax.core import mahalanobis_distance

function = jax.jit(mahalanobis_distance.squared_mahalanobis_and_log_determinant)


@pytest.mark.parametrize("size", [1, 3, 6])
@given(SEEDS)
def test_distance_and_log_determinant_are_those_of_numpy(size: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    P, error = random_covariance(rng, 10.0 ** rng.uniform(-1, 1, size)), rng.normal(size=size)
    squared_distance, log_determinant = function(P, error)
    np.testing.assert_allclose(squared_distance, error @ np.linalg.solve(P, error), rtol=1e-10)
    np.testing.assert_allclose(log_determinant, np.linalg.slogdet(P)[1], rtol=1e-10, atol=1e-10)
