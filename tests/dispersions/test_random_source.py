"""Coordinates from 0 to 1 become numbers of the distributions that each kind of dispersion declares."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from rpojax.core import random_streams
from rpojax.dispersions import dispersed_values
from rpojax.scenario import dispersion_keys
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

RUNS = 2000
KEPT = 0.001
"""Least p-value: below it a right map is refused for one seed in a thousand, and the seed is fixed."""


def values_at(mission: ScenarioFile, entry: dict[str, object], unit: np.ndarray) -> np.ndarray:
    """What a dispersion makes of coordinates (runs, n)."""
    file = scenario_loader.validate(mission.model_dump() | {"dispersions": [entry]})
    name = dispersion_keys.dispersion_name(file.dispersions[0])
    [key] = dispersion_keys.varied_keys(file)

    def one(row: jax.Array) -> jax.Array:
        return dispersed_values.draw(file, random_streams.master_key(0), {name: row})[key]

    return np.asarray(jax.jit(jax.vmap(one))(jnp.asarray(unit)))


@pytest.fixture(scope="module")
def unit() -> np.ndarray:
    """Independent coordinates (runs, 4)."""
    return np.random.default_rng(5).random((RUNS, 4))


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ({"key": "servicer.mass_kg", "kind": "normal", "sigma": 0.3}, stats.norm(30.0, 0.3)),
        (
            {"key": "servicer.mass_kg", "kind": "truncated_normal", "sigma": 0.3, "limit_sigmas": 1.5},
            stats.truncnorm(-1.5, 1.5, 30.0, 0.3),
        ),
        ({"key": "orbit.true_anomaly_deg", "kind": "uniform", "low": -30.0, "high": 90.0}, stats.uniform(-30.0, 120.0)),
        ({"key": "gps.noise_m", "kind": "log_normal", "sigma": 0.4}, stats.lognorm(0.4, scale=2.0)),
        ({"key": "initial.relative_position_m[1]", "kind": "normal", "sigma": 2.0}, stats.norm(-50.0, 2.0)),
    ],
    ids=lambda value: value["kind"] if isinstance(value, dict) else "",
)
def test_a_number_is_the_inverse_distribution_at_its_coordinate(
    mission: ScenarioFile, unit: np.ndarray, entry: dict[str, object], expected: object
) -> None:
    found = values_at(mission, entry, unit[:, :1])
    if found.ndim == 2:  # one component of a vector; the others are nominal
        assert np.all(found[:, [0, 2]] == 0.0)
        found = found[:, 1]
    np.testing.assert_allclose(found, expected.ppf(unit[:, 0]), rtol=1e-12)  # type: ignore[attr-defined]


def test_components_of_a_vector_have_a_coordinate_each(mission: ScenarioFile, unit: np.ndarray) -> None:
    entry = {"key": "initial.relative_position_m", "kind": "normal", "sigma": [1.0, 2.0, 0.0]}
    found = values_at(mission, entry, unit[:, :3])
    expected = stats.norm.ppf(unit[:, :3]) * [1.0, 2.0, 0.0] + [0.0, -50.0, 0.0]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_a_choice_takes_equal_parts_of_its_coordinate(mission: ScenarioFile) -> None:
    ends = np.array([[2.0**-53], [0.333], [0.334], [0.666], [0.667], [1.0 - 2.0**-53]])
    entry = {"key": "target.tumble_rate_deg_s", "kind": "choice", "values": [0.0, 1.0, 5.0]}
    assert values_at(mission, entry, ends).tolist() == [0.0, 0.0, 1.0, 1.0, 5.0, 5.0]


def test_directions_are_unit_and_uniform_over_the_sphere(mission: ScenarioFile, unit: np.ndarray) -> None:
    found = values_at(mission, {"key": "target.tumble_axis", "kind": "direction"}, unit[:, :2])
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, rtol=1e-13)
    # Archimedes: along any axis the component is uniform.
    for axis in np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.36, 0.48, 0.8]]):
        assert stats.kstest(found @ axis, stats.uniform(-1.0, 2.0).cdf).pvalue > KEPT


def test_attitudes_are_unit_and_uniform_over_all_of_them(mission: ScenarioFile, unit: np.ndarray) -> None:
    found = values_at(mission, {"key": "target.attitude", "kind": "attitude"}, unit[:, :3])
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, rtol=1e-13)
    # A component c of a uniform point of the 3-sphere has the density 2 / pi sqrt(1 - c^2).
    for axis in np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.5, -0.5, 0.5, 0.5]]):
        assert stats.kstest((found @ axis + 1.0) / 2.0, stats.beta(1.5, 1.5).cdf).pvalue > KEPT


def test_small_rotations_have_normal_angles(mission: ScenarioFile, unit: np.ndarray) -> None:
    entry = {"key": "target.attitude", "kind": "small_rotation", "sigma_deg": [1.0, 2.0, 3.0]}
    found = values_at(mission, entry, unit[:, :3])  # the nominal attitude is none
    angle = 2.0 * np.arccos(np.minimum(found[:, :1], 1.0))
    vector = np.rad2deg(angle * found[:, 1:] / np.sin(angle / 2.0))
    np.testing.assert_allclose(vector, stats.norm.ppf(unit[:, :3]) * [1.0, 2.0, 3.0], atol=1e-6)


COVARIANCE = np.array([[4.0, 0.012, 0.0], [0.012, 1e-4, -1e-6], [0.0, -1e-6, 4e-6]])
KEYS = ["initial.relative_position_m[0]", "initial.relative_velocity_m_s[1]", "servicer.mass_kg"]


def correlated(mission: ScenarioFile, unit: np.ndarray | None, covariance: np.ndarray = COVARIANCE) -> np.ndarray:
    """Errors (runs, 3) of three correlated numbers, drawn or at coordinates."""
    entry = {"kind": "correlated_normal", "keys": KEYS, "covariance": covariance.tolist()}
    file = scenario_loader.validate(mission.model_dump() | {"dispersions": [entry]})
    name = dispersion_keys.dispersion_name(file.dispersions[0])

    def one(run_id: jax.Array, row: jax.Array) -> jax.Array:
        given = {} if unit is None else {name: row}
        found = dispersed_values.draw(file, random_streams.fold_in(random_streams.master_key(1), run_id), given)
        position, velocity, mass = (found[key] for key in dispersion_keys.varied_keys(file))
        return jnp.stack([position[0], velocity[1], mass - 30.0])

    rows = np.zeros((RUNS, 3)) if unit is None else unit
    return np.asarray(jax.jit(jax.vmap(one))(jnp.arange(RUNS, dtype=jnp.int32), jnp.asarray(rows)))


def test_correlated_errors_have_the_covariance_asked_for(mission: ScenarioFile) -> None:
    errors = correlated(mission, None)
    sigma = np.sqrt(np.diag(COVARIANCE))
    # Of unit variances a sample covariance is off by 1 / sqrt(runs), for the diagonal by sqrt(2) times that.
    found = np.cov((errors / sigma).T)
    np.testing.assert_allclose(found, COVARIANCE / np.outer(sigma, sigma), atol=5.0 * np.sqrt(2.0 / RUNS))
    whitened = np.linalg.solve(np.linalg.cholesky(COVARIANCE), errors.T)
    for component in whitened:
        assert stats.kstest(component, stats.norm.cdf).pvalue > KEPT


def test_correlated_errors_at_coordinates_are_those_of_the_cholesky_factor(
    mission: ScenarioFile, unit: np.ndarray
) -> None:
    expected = stats.norm.ppf(unit[:, :3]) @ np.linalg.cholesky(COVARIANCE).T
    np.testing.assert_allclose(correlated(mission, unit[:, :3]), expected, rtol=1e-9, atol=1e-13)


def test_numbers_that_follow_another_in_full_have_a_singular_covariance(
    mission: ScenarioFile, unit: np.ndarray
) -> None:
    slopes = np.array([1.0, -2.0, 0.0])
    errors = correlated(mission, unit[:, :3], 0.01 * np.outer(slopes, slopes))
    np.testing.assert_allclose(errors[:, 1], -2.0 * errors[:, 0], rtol=1e-9)
    assert np.all(errors[:, 2] == 0.0)
    np.testing.assert_allclose(errors[:, 0], 0.1 * stats.norm.ppf(unit[:, 0]), rtol=1e-9)
