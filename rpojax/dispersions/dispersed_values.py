"""Dispersed values: of every run and key, drawn from the run's own random stream or given by the design."""

import zlib
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr, ndtri
from jaxtyping import Array

from rpojax.core import quaternion, random_streams
from rpojax.core.random_streams import Stream
from rpojax.dispersions.random_source import CoordinateSource, KeySource, RandomSource
from rpojax.physics import equipment_faults
from rpojax.scenario import dispersion_keys, schema
from rpojax.scenario import params as parameters
from rpojax.scenario.dispersion_keys import ParameterKey
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile

Values = dict[str, Array]


def draw(file: ScenarioFile, run_key: Array, assigned: Mapping[str, Array]) -> Values:
    """Values of all dispersed keys of one run, in the user's units.

    What is drawn depends on the run and on the key's name, so adding a dispersion leaves the others as they were.
    `given` is this run's part of a design: values by key, or coordinates from 0 to 1 by name of the dispersion.
    """
    stream = random_streams.fold_in(run_key, Stream.DISPERSION)
    values: Values = {}
    for text in dispersion_keys.design_keys(file):
        _set_value(file, values, dispersion_keys.parse_key(text), assigned[text])
    entries = dispersion_keys.evaluation_order(file)
    names = [dispersion_keys.dispersion_name(entry) for entry in entries]
    for entry, name, key in zip(entries, names, _keys(stream, names), strict=True):
        source = CoordinateSource(assigned[name]) if name in assigned else KeySource(key)
        match entry:
            case schema.Derived():
                _set_value(file, values, dispersion_keys.parse_key(entry.key), _derived(file, values, entry))
            case schema.CorrelatedNormal():
                places = dispersion_keys.expand_vectors(file, entry.keys)
                for place, error in zip(places, _correlated_errors(entry, source), strict=True):
                    _set_value(file, values, place, _nominal(file, place) + error)
            case _:
                place = dispersion_keys.parse_key(entry.key)
                _set_value(file, values, place, _draw_single_key(entry, _nominal(file, place), source))
    return values


def _keys(stream: Array, names: Sequence[str]) -> Array:
    """(n, 2) random keys of dispersions by their names."""
    numbers = np.array([zlib.crc32(name.encode()) & 0x7FFFFFFF for name in names], dtype=np.uint32)
    return random_streams.fold_in_per_key(jnp.broadcast_to(stream, (len(names), 2)), jnp.asarray(numbers))


def _nominal(file: ScenarioFile, place: ParameterKey) -> Array:
    return jnp.asarray(dispersion_keys.nominal_value(file, place), dtype=jnp.float64)


def _set_value(file: ScenarioFile, values: Values, place: ParameterKey, value: Array) -> None:
    """Enters a value; components that nothing gives stay nominal."""
    if place.index is None:
        values[place.key] = value
    else:
        whole = values.get(place.key, _nominal(file, ParameterKey(place.key, None)))
        values[place.key] = whole.at[place.index].set(value)


def _derived(file: ScenarioFile, values: Values, entry: schema.Derived) -> Array:
    shape = np.shape(dispersion_keys.nominal_value(file, dispersion_keys.parse_key(entry.key)))
    total = jnp.broadcast_to(jnp.asarray(entry.offset, dtype=jnp.float64), shape)
    for term in entry.terms:
        place = dispersion_keys.parse_key(term.key)
        value = values.get(place.key, _nominal(file, ParameterKey(place.key, None)))
        total = total + jnp.broadcast_to(term.factor * (value if place.index is None else value[place.index]), shape)
    return total


def _correlated_errors(entry: schema.CorrelatedNormal, source: RandomSource) -> Array:
    """(n,) normal errors with the covariance of the entry; the first takes no coordinate but its own."""
    factor = cholesky_factor(np.array(entry.covariance))
    normals = source.normals((len(factor),))
    return jnp.sum(jnp.asarray(factor) * normals[None, :], axis=1)


def cholesky_factor(covariance: np.ndarray) -> np.ndarray:
    """Lower triangular (n, n) whose product with its transpose is a positive semidefinite matrix (Cholesky).

    What rounding leaves of a variance that the earlier ones explain in full counts as zero.
    """
    variance = np.diag(covariance)
    factor = np.zeros_like(covariance)
    for column in range(len(covariance)):
        rest = covariance[column:, column] - factor[column:, :column] @ factor[column, :column]
        if rest[0] > 1e-9 * variance[column]:
            factor[column:, column] = rest / np.sqrt(rest[0])
    return factor


def _draw_single_key(dispersion: schema.Dispersion, nominal: Array, source: RandomSource) -> Array:
    match dispersion:
        case schema.Normal():
            return nominal + jnp.asarray(dispersion.sigma, dtype=jnp.float64) * source.normals(nominal.shape)
        case schema.TruncatedNormal():
            low, high = ndtr(-dispersion.limit_sigmas), ndtr(dispersion.limit_sigmas)
            cut = ndtri(low + (high - low) * source.uniforms(nominal.shape))
            return nominal + jnp.asarray(dispersion.sigma, dtype=jnp.float64) * cut
        case schema.Uniform():
            return dispersion.low + (dispersion.high - dispersion.low) * source.uniforms(nominal.shape)
        case schema.LogNormal():
            return nominal * jnp.exp(jnp.asarray(dispersion.sigma, dtype=jnp.float64) * source.normals(nominal.shape))
        case schema.Choice():
            choices = jnp.asarray([equipment_faults.kind_code(value) for value in dispersion.values], dtype=jnp.float64)
            return choices[source.integer(len(dispersion.values))]
        case schema.RandomDirection():
            return source.direction()
        case schema.RandomAttitude():
            return source.attitude()
        case schema.SmallRotation():
            sigma = jnp.deg2rad(jnp.asarray(dispersion.sigma_deg, dtype=jnp.float64))
            return quaternion.multiply(quaternion.exp(sigma * source.normals((3,))), quaternion.normalize(nominal))
        case schema.CorrelatedNormal() | schema.Derived():
            raise AssertionError(f"{dispersion.kind} is not drawn alone")


def apply_to_params(params: Params, values: Values) -> Params:
    """Params of one run: the nominal ones with the drawn values put in."""
    for key, value in values.items():
        path, factor = parameters.leaf_path_and_factor(key)
        params = parameters.replace_leaf(params, path, value * factor)
    return params


def read_back(params: Params, keys: list[str]) -> Values:
    """The values that `params` really holds for the given keys, in the user's units."""
    values: Values = {}
    for key in keys:
        path, factor = parameters.leaf_path_and_factor(key)
        values[key] = parameters.get_leaf(params, path) / factor
    return values
