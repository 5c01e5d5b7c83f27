"""Dispersed values: of every run and key, drawn from the run's own random stream or given by the design."""

import zlib
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr, ndtri
from jaxtyping import Array

from rpojax.core import quaternion, random_streams
from rpojax.core.random_streams import Stream
from rpojax.dispersions.random_source import Drawn, Placed, Source
from rpojax.physics import equipment_faults
from rpojax.scenario import dispersion_keys, schema
from rpojax.scenario import params as parameters
from rpojax.scenario.dispersion_keys import Place
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile

Values = dict[str, Array]


def draw(file: ScenarioFile, run_key: Array, given: Mapping[str, Array]) -> Values:
    """Values of all dispersed keys of one run, in the user's units.

    What is drawn depends on the run and on the key's name, so adding a dispersion leaves the others as they were.
    `given` is this run's part of a design: values by key, or coordinates from 0 to 1 by name of the dispersion.
    """
    stream = random_streams.fold_in(run_key, Stream.DISPERSION)
    values: Values = {}
    for text in dispersion_keys.tabled(file):
        _put(file, values, dispersion_keys.place(text), given[text])
    entries = dispersion_keys.in_order(file)
    names = [dispersion_keys.name(entry) for entry in entries]
    for entry, name, key in zip(entries, names, _keys(stream, names), strict=True):
        source = Placed(given[name]) if name in given else Drawn(key)
        match entry:
            case schema.Derived():
                _put(file, values, dispersion_keys.place(entry.key), _derived(file, values, entry))
            case schema.CorrelatedNormal():
                places = dispersion_keys.components(file, entry.keys)
                for place, error in zip(places, _errors(entry, source), strict=True):
                    _put(file, values, place, _nominal(file, place) + error)
            case _:
                place = dispersion_keys.place(entry.key)
                _put(file, values, place, _draw_one(entry, _nominal(file, place), source))
    return values


def _keys(stream: Array, names: Sequence[str]) -> Array:
    """(n, 2) random keys of dispersions by their names."""
    numbers = np.array([zlib.crc32(name.encode()) & 0x7FFFFFFF for name in names], dtype=np.uint32)
    return random_streams.fold_in_each(jnp.broadcast_to(stream, (len(names), 2)), jnp.asarray(numbers))


def _nominal(file: ScenarioFile, place: Place) -> Array:
    return jnp.asarray(dispersion_keys.nominal(file, place), dtype=jnp.float64)


def _put(file: ScenarioFile, values: Values, place: Place, value: Array) -> None:
    """Enters a value; components that nothing gives stay nominal."""
    if place.index is None:
        values[place.key] = value
    else:
        whole = values.get(place.key, _nominal(file, Place(place.key, None)))
        values[place.key] = whole.at[place.index].set(value)


def _derived(file: ScenarioFile, values: Values, entry: schema.Derived) -> Array:
    shape = np.shape(dispersion_keys.nominal(file, dispersion_keys.place(entry.key)))
    total = jnp.broadcast_to(jnp.asarray(entry.offset, dtype=jnp.float64), shape)
    for term in entry.terms:
        place = dispersion_keys.place(term.key)
        value = values.get(place.key, _nominal(file, Place(place.key, None)))
        total = total + jnp.broadcast_to(term.factor * (value if place.index is None else value[place.index]), shape)
    return total


def _errors(entry: schema.CorrelatedNormal, source: Source) -> Array:
    """(n,) normal errors with the covariance of the entry; the first takes no coordinate but its own."""
    factor = lower_factor(np.array(entry.covariance))
    normals = source.normals((len(factor),))
    return jnp.sum(jnp.asarray(factor) * normals[None, :], axis=1)


def lower_factor(covariance: np.ndarray) -> np.ndarray:
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


def _draw_one(dispersion: schema.Dispersion, nominal: Array, source: Source) -> Array:
    match dispersion:
        case schema.Normal():
            return nominal + jnp.asarray(dispersion.sigma, dtype=jnp.float64) * source.normals(nominal.shape)
        case schema.TruncatedNormal():
            low, high = ndtr(-dispersion.limit_sigmas), ndtr(dispersion.limit_sigmas)
            cut = ndtri(low + (high - low) * source.shares(nominal.shape))
            return nominal + jnp.asarray(dispersion.sigma, dtype=jnp.float64) * cut
        case schema.Uniform():
            return dispersion.low + (dispersion.high - dispersion.low) * source.shares(nominal.shape)
        case schema.LogNormal():
            return nominal * jnp.exp(jnp.asarray(dispersion.sigma, dtype=jnp.float64) * source.normals(nominal.shape))
        case schema.Choice():
            choices = jnp.asarray([equipment_faults.code(value) for value in dispersion.values], dtype=jnp.float64)
            return choices[source.pick(len(dispersion.values))]
        case schema.RandomDirection():
            return source.direction()
        case schema.RandomAttitude():
            return source.attitude()
        case schema.SmallRotation():
            sigma = jnp.deg2rad(jnp.asarray(dispersion.sigma_deg, dtype=jnp.float64))
            return quaternion.multiply(quaternion.exp(sigma * source.normals((3,))), quaternion.normalize(nominal))
        case schema.CorrelatedNormal() | schema.Derived():
            raise AssertionError(f"{dispersion.kind} is not drawn alone")


def apply(params: Params, values: Values) -> Params:
    """Params of one run: the nominal ones with the drawn values put in."""
    for key, value in values.items():
        path, factor = parameters.locate(key)
        params = parameters.put(params, path, value * factor)
    return params


def read_back(params: Params, keys: list[str]) -> Values:
    """The values that `params` really holds for the given keys, in the user's units."""
    values: Values = {}
    for key in keys:
        path, factor = parameters.locate(key)
        values[key] = parameters.get(params, path) / factor
    return values
