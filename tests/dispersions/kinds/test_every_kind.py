"""What every kind of dispersion must satisfy: coordinates, labels, marginal distributions, linearisation."""

from typing import Any, get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import kstest

from rpojax.dispersions.coordinate_source import CoordinateSource
from rpojax.dispersions.key_source import KeySource
from rpojax.dispersions.kinds.dispersion_kind import RandomKind
from rpojax.dispersions.kinds.registry import Dispersion, recorded_dispersion
from rpojax.dispersions.marginal_distribution import DiscreteDistribution
from rpojax.errors import RpojaxError
from rpojax.simulation.noise import run_keys

RUNS = 2000
LEAST_P_VALUE = 1e-3
"""Least accepted p-value; the seed is fixed."""

CASES: dict[str, tuple[dict[str, Any], Any]] = {
    "normal": ({"key": "k", "sigma": [1.0, 2.0, 0.0]}, [0.0, -50.0, 0.0]),
    "truncated_normal": ({"key": "k", "sigma": 2.0, "limit_sigmas": 1.5}, 30.0),
    "uniform": ({"key": "k", "low": -1.0, "high": 3.0}, [0.0, 0.0]),
    "log_normal": ({"key": "k", "sigma": [0.4, 0.1]}, [2.0, 5.0]),
    "choice": ({"key": "k", "values": [0.0, 1.0, 5.0]}, 1.0),
    "direction": ({"key": "k"}, [0.0, 0.0, 1.0]),
    "attitude": ({"key": "k"}, [1.0, 0.0, 0.0, 0.0]),
    "small_rotation": ({"key": "k", "sigma_deg": [1.0, 0.0, 3.0]}, [0.5, -0.5, -0.5, 0.5]),
    "correlated_normal": (
        {"keys": ["k", "l"], "covariance": [[4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]]},
        [1.0, 2.0, 3.0],
    ),
}
"""Settings of each random kind, and a nominal value."""
LINEARISED = ("normal", "truncated_normal", "uniform", "log_normal", "small_rotation", "correlated_normal")


def kind_and_nominal(kind: str) -> tuple[RandomKind, np.ndarray]:
    """The dispersion of a case with its nominal value."""
    settings, nominal = CASES[kind]
    entry = recorded_dispersion(settings | {"kind": kind})
    assert isinstance(entry, RandomKind)
    return entry, np.array(nominal)


def values_at(entry: RandomKind, nominal: np.ndarray, unit: np.ndarray) -> np.ndarray:
    """Values (points, ...) at points (points, coordinates) of the unit cube."""
    draw = jax.jit(jax.vmap(lambda row: entry.draw(jnp.asarray(nominal), CoordinateSource(row))))
    return np.asarray(draw(unit))


def test_the_cases_cover_all_random_kinds() -> None:
    models = [model for model in get_args(get_args(Dispersion)[0]) if issubclass(model, RandomKind)]
    assert set(CASES) == {get_args(model.model_fields["kind"].annotation)[0] for model in models}


@pytest.mark.parametrize("kind", CASES)
def test_the_coordinates_that_vary_change_the_value_and_no_others_do(kind: str) -> None:
    entry, nominal = kind_and_nominal(kind)
    count = entry.coordinate_count(nominal)
    middle = np.full((1, count), 0.45)
    start = values_at(entry, nominal, middle)
    assert start.shape == (1, *nominal.shape)
    moved = values_at(entry, nominal, middle + 0.3 * np.eye(count))
    changed = np.any((moved != start).reshape(count, -1), axis=1)
    np.testing.assert_array_equal(changed, entry.varies(nominal))


@pytest.mark.parametrize("kind", CASES)
def test_a_kind_says_whether_it_uses_the_nominal_value(kind: str) -> None:
    entry, nominal = kind_and_nominal(kind)
    unit = np.full((1, entry.coordinate_count(nominal)), 0.3)
    other = nominal[::-1] + 1.0 if nominal.ndim else nominal + 1.0
    same = np.array_equal(values_at(entry, nominal, unit), values_at(entry, other, unit))
    assert same != entry.uses_nominal


@pytest.mark.parametrize("kind", CASES)
def test_every_coordinate_has_its_own_label(kind: str) -> None:
    entry, nominal = kind_and_nominal(kind)
    labels = entry.coordinate_labels([f"k[{index}]" for index in range(nominal.size)])
    assert len(set(labels)) == len(labels) == entry.coordinate_count(nominal)


@pytest.mark.parametrize("kind", [kind for kind in CASES if kind_and_nominal(kind)[0].is_separable])
def test_a_separable_value_is_the_quantile_at_its_coordinate(kind: str) -> None:
    entry, nominal = kind_and_nominal(kind)
    unit = np.random.default_rng(5).random((50, entry.coordinate_count(nominal)))
    values = values_at(entry, nominal, unit).reshape(len(unit), -1)
    for coordinate, column, marginal in zip(unit.T, values.T, entry.marginals(nominal.ravel()), strict=True):
        if marginal is None:
            assert np.ptp(column) == 0.0
            continue
        np.testing.assert_allclose(column, marginal.ppf(coordinate), rtol=1e-12, atol=1e-12)
        if not isinstance(marginal, DiscreteDistribution):
            np.testing.assert_allclose(marginal.cdf(column), coordinate, rtol=1e-9)


@pytest.mark.parametrize("kind", [kind for kind in CASES if kind != "choice"])
def test_drawn_numbers_have_their_marginal_distributions(kind: str) -> None:
    entry, nominal = kind_and_nominal(kind)
    keys = run_keys(1, np.arange(RUNS))
    drawn = np.asarray(jax.jit(jax.vmap(lambda key: entry.draw(jnp.asarray(nominal), KeySource(key))))(keys))
    rows = drawn.reshape(RUNS, -1)
    columns = entry.shown_numbers(rows, nominal.ravel()) or dict(enumerate(rows.T))
    for column, marginal in zip(columns.values(), entry.marginals(nominal.ravel()), strict=True):
        if marginal is None:
            np.testing.assert_allclose(column, column[0], atol=1e-12)
        else:
            assert kstest(column, marginal.cdf).pvalue > LEAST_P_VALUE


@pytest.mark.parametrize("kind", CASES)
def test_kinds_with_small_deviations_have_a_mean_and_columns_and_the_others_say_so(kind: str) -> None:
    entry, nominal = kind_and_nominal(kind)
    if kind in LINEARISED:
        mean, columns = entry.linearise(nominal)
        assert mean.shape == nominal.shape
        assert columns.shape == (nominal.size, entry.coordinate_count(nominal))
        np.testing.assert_array_equal(np.any(columns != 0.0, axis=0), entry.varies(nominal))
    else:
        with pytest.raises(RpojaxError, match=f"^dispersions: found kind '{kind}' for 'k', expected one with small"):
            entry.linearise(nominal)


def test_a_recorded_dispersion_of_an_unknown_kind_is_ignored() -> None:
    assert recorded_dispersion({"key": "k", "kind": "cauchy", "scale": 1.0}) is None
