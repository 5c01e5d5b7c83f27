"""Dispersed values at coordinates of the unit cube by inverse distributions."""

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


def values_at(mission: ScenarioFile, entry: dict[str, object], unit: np.ndarray) -> np.ndarray:
    """Values of a dispersion at coordinates (runs, n)."""
    file = scenario_loader.validate(mission.model_dump() | {"dispersions": [entry]})
    name = file.dispersions[0].name
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
def test_a_value_is_the_inverse_distribution_at_its_coordinate(
    mission: ScenarioFile, unit: np.ndarray, entry: dict[str, object], expected: object
) -> None:
    found = values_at(mission, entry, unit[:, :1])
    if found.ndim == 2:  # one component of a vector; the others are nominal
        assert np.all(found[:, [0, 2]] == 0.0)
        found = found[:, 1]
    np.testing.assert_allclose(found, expected.ppf(unit[:, 0]), rtol=1e-12)  # type: ignore[attr-defined]


def test_each_component_of_a_vector_has_a_coordinate(mission: ScenarioFile, unit: np.ndarray) -> None:
    entry = {"key": "initial.relative_position_m", "kind": "normal", "sigma": [1.0, 2.0, 0.0]}
    found = values_at(mission, entry, unit[:, :3])
    expected = stats.norm.ppf(unit[:, :3]) * [1.0, 2.0, 0.0] + [0.0, -50.0, 0.0]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_a_choice_divides_its_coordinate_into_equal_intervals(mission: ScenarioFile) -> None:
    ends = np.array([[2.0**-53], [0.333], [0.334], [0.666], [0.667], [1.0 - 2.0**-53]])
    entry = {"key": "target.tumble_rate_deg_s", "kind": "choice", "values": [0.0, 1.0, 5.0]}
    assert values_at(mission, entry, ends).tolist() == [0.0, 0.0, 1.0, 1.0, 5.0, 5.0]


def test_directions_are_uniform_on_the_sphere(mission: ScenarioFile, unit: np.ndarray) -> None:
    found = values_at(mission, {"key": "target.tumble_axis", "kind": "direction"}, unit[:, :2])
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, rtol=1e-13)
    # Archimedes: along any axis the component is uniform.
    for axis in np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.36, 0.48, 0.8]]):
        assert stats.kstest(found @ axis, stats.uniform(-1.0, 2.0).cdf).pvalue > LEAST_P_VALUE


def test_attitudes_are_uniform(mission: ScenarioFile, unit: np.ndarray) -> None:
    found = values_at(mission, {"key": "target.attitude", "kind": "attitude"}, unit[:, :3])
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, rtol=1e-13)
    # A component c of a uniform point of the 3-sphere has the density 2 / pi sqrt(1 - c^2).
    for axis in np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.5, -0.5, 0.5, 0.5]]):
        assert stats.kstest((found @ axis + 1.0) / 2.0, stats.beta(1.5, 1.5).cdf).pvalue > LEAST_P_VALUE


def test_small_rotations_have_normal_angles(mission: ScenarioFile, unit: np.ndarray) -> None:
    entry = {"key": "target.attitude", "kind": "small_rotation", "sigma_deg": [1.0, 2.0, 3.0]}
    found = values_at(mission, entry, unit[:, :3])  # the nominal attitude is the identity
    angle = 2.0 * np.arccos(np.minimum(found[:, :1], 1.0))
    vector = np.rad2deg(angle * found[:, 1:] / np.sin(angle / 2.0))
    np.testing.assert_allclose(vector, stats.norm.ppf(unit[:, :3]) * [1.0, 2.0, 3.0], atol=1e-6)
