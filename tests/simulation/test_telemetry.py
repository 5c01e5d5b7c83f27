"""What is derived for the records is what textbooks say."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.simulation.channels import squared_mahalanobis

CONDITIONED = 1e-9
"""Relative error allowed for covariances whose scales differ by a million."""


@pytest.mark.parametrize("size", [1, 6])
def test_mahalanobis_is_the_quadratic_form_of_the_inverse_covariance(size: int) -> None:
    rng = np.random.default_rng(size)
    scales = np.logspace(0, -3, size)
    root = rng.normal(size=(size, size)) * scales[:, None]
    covariance = root @ root.T + np.diag(1e-3 * scales**2)
    error = rng.normal(size=size) * scales
    found = jax.jit(squared_mahalanobis)(jnp.asarray(covariance), jnp.asarray(error))
    np.testing.assert_allclose(found, error @ np.linalg.solve(covariance, error), rtol=CONDITIONED)


def test_mahalanobis_of_correlated_errors_is_not_that_of_their_variances() -> None:
    covariance = jnp.array([[1.0, 0.9], [0.9, 1.0]])
    together = squared_mahalanobis(covariance, jnp.array([1.0, 1.0]))
    apart = squared_mahalanobis(covariance, jnp.array([1.0, -1.0]))
    np.testing.assert_allclose(together, 2.0 / 1.9, rtol=CONDITIONED)
    np.testing.assert_allclose(apart, 2.0 / 0.1, rtol=CONDITIONED)
