"""Dispersions as functions of standard normal variables: distributions, labels, and scenarios with fixed values."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scenario_variants import with_dispersions
from scipy.stats import kstest, norm

from rpojax.core import random_streams
from rpojax.dispersions.designs import design_sections
from rpojax.errors import ScenarioError
from rpojax.scenario.dispersed_numbers import dispersed_values, dispersion_keys, standard_normal_space
from rpojax.scenario.dispersed_numbers.standard_normal_space import StandardNormalSpace
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.parameter_keys import nominal_of_key
from rpojax.scenario.schema import ScenarioFile

RUNS = 2000
LEAST_P_VALUE = 1e-4
"""Least accepted p-value; the seed is fixed."""
KEY = random_streams.fold_in(random_streams.master_key(5), 7)

ENTRIES: list[dict[str, Any]] = [
    {"key": "initial.relative_position_m", "kind": "normal", "sigma": [1.0, 2.0, 0.0]},
    {"key": "servicer.mass_kg", "kind": "truncated_normal", "sigma": 2.0, "limit_sigmas": 1.5},
    {"key": "orbit.true_anomaly_deg", "kind": "uniform", "low": -30.0, "high": 90.0},
    {"key": "gps.noise_m", "kind": "log_normal", "sigma": 0.4},
    {"key": "target.tumble_rate_deg_s", "kind": "choice", "values": [0.0, 1.0, 5.0]},
    {"key": "target.tumble_axis", "kind": "direction"},
    {"key": "target.attitude", "kind": "attitude"},
    {"key": "camera.mounting", "kind": "small_rotation", "sigma_deg": [1.0, 0.0, 3.0]},
    {
        "keys": ["thruster.force_n", "thruster.force_scale"],
        "kind": "correlated_normal",
        "covariance": [[4e-6, 1e-5], [1e-5, 1e-4]],
    },
    {"key": "target.mass_kg", "kind": "derived", "offset": 1.0, "terms": [{"key": "servicer.mass_kg", "factor": 2.0}]},
    {"key": "thruster.position_m[1]", "kind": "normal", "sigma": 0.1},
    {"key": "target.inertia_kg_m2", "kind": "normal", "sigma": 0.01},
]


@pytest.fixture(scope="module")
def space(mission: ScenarioFile) -> StandardNormalSpace:
    return standard_normal_space.make_space(with_dispersions(mission, *ENTRIES))


@pytest.fixture(scope="module")
def values(space: StandardNormalSpace) -> dict[str, np.ndarray]:
    """Values at many points, all with the key of one run."""
    z = np.random.default_rng(1).normal(size=(RUNS, space.dimension))
    found = jax.jit(jax.vmap(space.values_at, in_axes=(0, None)))(jnp.asarray(z), jnp.asarray(KEY))
    return {name: np.asarray(value) for name, value in found.items()}


def test_every_variable_has_a_label_and_a_group(space: StandardNormalSpace) -> None:
    assert space.dimension == len(space.labels) == len(space.groups) == 2 + 1 + 1 + 1 + 2 + 3 + 2 + 2 + 1
    assert len(set(space.labels)) == space.dimension
    assert space.labels[:3] == ("initial.relative_position_m[0]", "initial.relative_position_m[1]", "servicer.mass_kg")
    assert space.labels[5:7] == ("target.tumble_axis (height)", "target.tumble_axis (azimuth)")
    assert space.labels[10:12] == ("camera.mounting[0]", "camera.mounting[2]")
    assert set(space.groups[5:]) == {
        *("target.tumble_axis", "target.attitude", "camera.mounting"),
        *("thruster.force_n+thruster.force_scale", "thruster.position_m[1]"),
    }
    assert space.unmapped == ("target.tumble_rate_deg_s", "target.inertia_kg_m2")


@pytest.mark.parametrize(
    ("column", "group"),
    [
        ("initial.relative_position_m[1]", "initial.relative_position_m[1]"),
        ("target.tumble_axis[2]", "target.tumble_axis"),
        ("thruster.force_n", "thruster.force_n+thruster.force_scale"),
        ("target.tumble_rate_deg_s", None),
    ],
)
def test_dispersed_numbers_belong_to_groups(space: StandardNormalSpace, column: str, group: str | None) -> None:
    assert space.group_of(column) == group


def test_distributions_are_those_of_the_scenario(
    space: StandardNormalSpace, values: dict[str, np.ndarray], mission: ScenarioFile
) -> None:
    position = values["initial.relative_position_m"] - np.array(mission.initial.relative_position_m)
    axis, attitude = values["target.tumble_axis"], values["target.attitude"]
    low, high = norm.cdf([-1.5, 1.5])
    quantiles = {
        "normal": norm.cdf(position[:, 1] / 2.0),
        "truncated": (norm.cdf((values["servicer.mass_kg"] - mission.servicer.mass_kg) / 2.0) - low) / (high - low),
        "uniform": (values["orbit.true_anomaly_deg"] + 30.0) / 120.0,
        "log_normal": norm.cdf(np.log(values["gps.noise_m"] / mission.gps.noise_m) / 0.4),
        "height": (axis[:, 2] + 1.0) / 2.0,
        "azimuth": np.arctan2(axis[:, 1], axis[:, 0]) / (2.0 * np.pi) + 0.5,
        "attitude": attitude[:, 0] ** 2 + attitude[:, 1] ** 2,
        "correlated": norm.cdf((values["thruster.force_scale"] - 1.0) / 0.01),
    }
    assert {name: kstest(quantile, "uniform").pvalue for name, quantile in quantiles.items()} == {
        name: pytest.approx(1.0, abs=1.0 - LEAST_P_VALUE) for name in quantiles
    }
    pair = np.stack([values["thruster.force_n"], values["thruster.force_scale"]])
    np.testing.assert_allclose(np.corrcoef(pair)[0, 1], 0.5, atol=0.1)
    np.testing.assert_allclose(values["target.mass_kg"], 1.0 + 2.0 * values["servicer.mass_kg"], rtol=1e-12)
    assert np.all(position[:, 2] == 0.0)


def test_unmapped_dispersions_have_the_values_of_the_random_key(
    space: StandardNormalSpace, values: dict[str, np.ndarray]
) -> None:
    drawn = jax.jit(lambda key: dispersed_values.draw(space.file, key, {}))(jnp.asarray(KEY))
    for name in space.unmapped:
        np.testing.assert_allclose(values[name], np.broadcast_to(drawn[name], values[name].shape), rtol=1e-12)


def test_the_origin_is_the_median(space: StandardNormalSpace, mission: ScenarioFile) -> None:
    median = jax.jit(space.values_at)(jnp.zeros(space.dimension), jnp.asarray(KEY))
    np.testing.assert_allclose(median["initial.relative_position_m"], mission.initial.relative_position_m)
    np.testing.assert_allclose(median["orbit.true_anomaly_deg"], 30.0)
    np.testing.assert_allclose(median["gps.noise_m"], mission.gps.noise_m)


def test_a_scenario_with_fixed_values_draws_these_values(space: StandardNormalSpace) -> None:
    z = np.random.default_rng(2).normal(size=space.dimension)
    values = {name: np.asarray(value) for name, value in jax.jit(space.values_at)(jnp.asarray(z), KEY).items()}
    fixed = scenario_loader.validate(standard_normal_space.with_fixed_values(space, values).model_dump(mode="json"))
    again = jax.jit(lambda key: dispersed_values.draw(fixed, key, {}))(jnp.asarray(KEY))
    assert dispersion_keys.varied_keys(fixed) == dispersion_keys.varied_keys(space.file)
    for name, value in values.items():
        np.testing.assert_allclose(again[name], value, rtol=1e-12, err_msg=name)


def test_a_scenario_without_continuous_dispersion_is_refused(mission: ScenarioFile) -> None:
    without = [ENTRIES[4], {"key": "servicer.mass_kg", "kind": "normal", "sigma": 0.0}]
    with pytest.raises(ScenarioError, match=r"^dispersions: found \['target.tumble_rate_deg_s', 'servicer.mass_kg'\]"):
        standard_normal_space.make_space(with_dispersions(mission, *without))


def test_a_design_that_assigns_values_is_refused(mission: ScenarioFile) -> None:
    grid = {"kind": "grid", "values": {"gps.noise_m": [1.0, 2.0]}}
    file = scenario_loader.validate(mission.model_dump() | {"dispersions": ENTRIES[:1], "design": grid})
    with pytest.raises(ScenarioError, match=r"^design.kind: found 'grid', expected a design whose values"):
        standard_normal_space.make_space(file)


def test_a_scenario_with_fixed_values_has_independent_runs(mission: ScenarioFile) -> None:
    file = scenario_loader.validate(
        mission.model_dump() | {"design": design_sections.SobolDesign(kind="sobol").model_dump()}
    )
    space = standard_normal_space.make_space(file)
    values = {name: np.zeros(np.shape(nominal_of_key(file, name))) for name in dispersion_keys.varied_keys(file)}
    assert standard_normal_space.with_fixed_values(space, values).design.kind == "independent"
