"""Cholesky factor of semidefinite matrices, and correlated errors with it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from rpojax.core import random_streams
from rpojax.scenario.dispersed_numbers import dispersed_values, dispersion_keys
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

RUNS = 2000
LEAST_P_VALUE = 0.001
"""Least accepted p-value; the seed is fixed."""


@pytest.fixture(scope="module")
def unit() -> np.ndarray:
    """Independent coordinates (runs, 4)."""
    return np.random.default_rng(5).random((RUNS, 4))


COVARIANCE = np.array([[4.0, 0.012, 0.0], [0.012, 1e-4, -1e-6], [0.0, -1e-6, 4e-6]])
KEYS = ["initial.relative_position_m[0]", "initial.relative_velocity_m_s[1]", "servicer.mass_kg"]


def correlated(mission: ScenarioFile, unit: np.ndarray | None, covariance: np.ndarray = COVARIANCE) -> np.ndarray:
    """Errors (runs, 3) of three correlated numbers, with random keys or at coordinates."""
    entry = {"kind": "correlated_normal", "keys": KEYS, "covariance": covariance.tolist()}
    file = scenario_loader.validate(mission.model_dump() | {"dispersions": [entry]})
    name = file.dispersions[0].name

    def one(run_id: jax.Array, row: jax.Array) -> jax.Array:
        assigned = {} if unit is None else {name: row}
        found = dispersed_values.draw(file, random_streams.fold_in(random_streams.master_key(1), run_id), assigned)
        position, velocity, mass = (found[key] for key in dispersion_keys.varied_keys(file))
        return jnp.stack([position[0], velocity[1], mass - 30.0])

    rows = np.zeros((RUNS, 3)) if unit is None else unit
    return np.asarray(jax.jit(jax.vmap(one))(jnp.arange(RUNS, dtype=jnp.int32), jnp.asarray(rows)))


def test_correlated_errors_have_the_specified_covariance(mission: ScenarioFile) -> None:
    errors = correlated(mission, None)
    sigma = np.sqrt(np.diag(COVARIANCE))
    # The standard deviation of a sample correlation is 1 / sqrt(runs), of a normalised variance sqrt(2) times that.
    found = np.cov((errors / sigma).T)
    np.testing.assert_allclose(found, COVARIANCE / np.outer(sigma, sigma), atol=5.0 * np.sqrt(2.0 / RUNS))
    whitened = np.linalg.solve(np.linalg.cholesky(COVARIANCE), errors.T)
    for component in whitened:
        assert stats.kstest(component, stats.norm.cdf).pvalue > LEAST_P_VALUE


def test_correlated_errors_at_coordinates_are_those_of_the_cholesky_factor(
    mission: ScenarioFile, unit: np.ndarray
) -> None:
    expected = stats.norm.ppf(unit[:, :3]) @ np.linalg.cholesky(COVARIANCE).T
    np.testing.assert_allclose(correlated(mission, unit[:, :3]), expected, rtol=1e-9, atol=1e-13)


def test_a_singular_covariance_gives_linearly_dependent_errors(mission: ScenarioFile, unit: np.ndarray) -> None:
    gains = np.array([1.0, -2.0, 0.0])
    errors = correlated(mission, unit[:, :3], 0.01 * np.outer(gains, gains))
    np.testing.assert_allclose(errors[:, 1], -2.0 * errors[:, 0], rtol=1e-9)
    assert np.all(errors[:, 2] == 0.0)
    np.testing.assert_allclose(errors[:, 0], 0.1 * stats.norm.ppf(unit[:, 0]), rtol=1e-9)
