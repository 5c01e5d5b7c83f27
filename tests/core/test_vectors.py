"""Products of vectors and matrices against numpy's."""

import jax
import numpy as np
import pytest
from hypothesis import given
from numpy_reference import SEEDS

from rpojax.core import vectors

EXACT = 1e-14  # a few roundings of numbers near one

apply = jax.jit(vectors.apply)
apply_transposed = jax.jit(vectors.apply_transposed)
cross = jax.jit(vectors.cross)
product = jax.jit(vectors.product)


@given(SEEDS)
def test_applying_a_matrix_or_its_transpose_is_the_matrix_product(seed: int) -> None:
    rng = np.random.default_rng(seed)
    M, v = rng.normal(size=(3, 3)), rng.normal(size=3)
    np.testing.assert_allclose(apply(M, v), M @ v, atol=EXACT * 10)
    np.testing.assert_allclose(apply_transposed(M, v), M.T @ v, atol=EXACT * 10)


@given(SEEDS)
def test_the_cross_product_is_that_of_numpy(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=(2, 3))
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), atol=EXACT)


@pytest.mark.parametrize("shape", [(3, 3, 3), (2, 5, 4), (6, 1, 3), (1, 2, 1)])
def test_the_product_of_matrices_is_that_of_numpy(shape: tuple[int, int, int]) -> None:
    m, n, k = shape
    rng = np.random.default_rng(0)
    A, B = rng.normal(size=(m, n)), rng.normal(size=(n, k))
    np.testing.assert_allclose(product(A, B), A @ B, atol=EXACT)
