"""Clohessy-Wiltshire motion against the matrix exponential of its differential equations."""

import jax
import numpy as np
import pytest
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
