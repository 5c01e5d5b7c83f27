"""Values of the dispersed keys of one run, and the parameters with these values."""

import zlib
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core import random_streams
from rpojax.core.random_streams import Stream
from rpojax.dispersions.dispersion_kinds import CorrelatedNormal, Derived
from rpojax.dispersions.distributions import correlated_errors, sample
from rpojax.dispersions.random_source import CoordinateSource, KeySource
from rpojax.scenario import params as parameters
from rpojax.scenario.dispersed_numbers.dispersion_keys import design_keys, dispersion_name, evaluation_order
from rpojax.scenario.parameter_keys import ParameterKey, expand_vectors, nominal_value, parse_key
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile

Values = dict[str, Array]
"""Value by key, in the unit of the key."""


def draw(file: ScenarioFile, run_key: Array, assigned: Mapping[str, Array]) -> Values:
    """Values of all dispersed keys of one run.

    Random numbers depend on the run's key and the dispersion's name, so that adding a dispersion leaves the others
    unchanged. `assigned` is this run's part of a design: values by key, or coordinates in (0, 1) by dispersion name.
    """
    stream = random_streams.fold_in(run_key, Stream.DISPERSION)
    values: Values = {}
    for text in design_keys(file):
        _set_value(file, values, parse_key(text), assigned[text])
    entries = evaluation_order(file)
    names = [dispersion_name(entry) for entry in entries]
    for entry, name, key in zip(entries, names, _random_keys(stream, names), strict=True):
        source = CoordinateSource(assigned[name]) if name in assigned else KeySource(key)
        match entry:
            case Derived():
                _set_value(file, values, parse_key(entry.key), _derived_value(file, values, entry))
            case CorrelatedNormal():
                components = expand_vectors(file, entry.keys)
                for parameter, error in zip(components, correlated_errors(entry, source), strict=True):
                    _set_value(file, values, parameter, _nominal(file, parameter) + error)
            case _:
                parameter = parse_key(entry.key)
                _set_value(file, values, parameter, sample(entry, _nominal(file, parameter), source))
    return values


def _random_keys(stream: Array, names: Sequence[str]) -> Array:
    """(n, 2) random keys of dispersions by their names."""
    numbers = np.array([zlib.crc32(name.encode()) & 0x7FFFFFFF for name in names], dtype=np.uint32)
    return random_streams.fold_in_per_key(jnp.broadcast_to(stream, (len(names), 2)), jnp.asarray(numbers))


def _nominal(file: ScenarioFile, parameter: ParameterKey) -> Array:
    return jnp.asarray(nominal_value(file, parameter), dtype=jnp.float64)


def _set_value(file: ScenarioFile, values: Values, parameter: ParameterKey, value: Array) -> None:
    """Enters a value or a component of one, whose other components stay as they are, or nominal."""
    if parameter.index is None:
        values[parameter.key] = value
    else:
        whole = values.get(parameter.key, _nominal(file, ParameterKey(parameter.key, None)))
        values[parameter.key] = whole.at[parameter.index].set(value)


def _derived_value(file: ScenarioFile, values: Values, entry: Derived) -> Array:
    """Offset plus a linear combination of values of the run."""
    shape = np.shape(nominal_value(file, parse_key(entry.key)))
    total = jnp.broadcast_to(jnp.asarray(entry.offset, dtype=jnp.float64), shape)
    for term in entry.terms:
        parameter = parse_key(term.key)
        value = values.get(parameter.key, _nominal(file, ParameterKey(parameter.key, None)))
        component = value if parameter.index is None else value[parameter.index]
        total = total + jnp.broadcast_to(term.factor * component, shape)
    return total


def apply_to_params(params: Params, values: Values) -> Params:
    """Parameters of one run: nominal ones with the dispersed values."""
    for key, value in values.items():
        path, factor = parameters.leaf_path_and_factor(key)
        params = parameters.replace_leaf(params, path, value * factor)
    return params


def read_back(params: Params, keys: list[str]) -> Values:
    """Values that `params` holds for the keys, in the unit of the key."""
    values: Values = {}
    for key in keys:
        path, factor = parameters.leaf_path_and_factor(key)
        values[key] = parameters.get_leaf(params, path) / factor
    return values
