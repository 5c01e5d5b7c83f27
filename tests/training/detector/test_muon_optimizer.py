"""Orthogonalisation of a gradient against its singular value decomposition."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.training.training_steps import orthogonalize


@pytest.mark.parametrize("shape", [(3, 3, 16, 32), (1, 1, 64, 48), (1, 1, 8, 64)])
def test_orthogonalized_step_has_singular_values_near_one(shape: tuple[int, ...]) -> None:
    gradient = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    matrix = gradient.reshape(-1, shape[-1])
    step = np.asarray(orthogonalize(jnp.asarray(gradient))).reshape(matrix.shape)
    left, values, right = np.linalg.svd(matrix, full_matrices=False)
    found = left.T @ step @ right.T
    # The polynomial only approximates orthogonality: singular values between 0.7 and 1.2.
    assert 0.65 < np.diag(found).min() <= np.diag(found).max() < 1.25
    np.testing.assert_allclose(found - np.diag(np.diag(found)), 0.0, atol=1e-3)
    assert values.max() / values.min() > 1.5
