"""Values of the dispersed keys of one run, and the parameters with these values."""

import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core import random_streams
from rpojax.core.random_streams import Stream
from rpojax.dispersions.coordinate_source import CoordinateSource
from rpojax.dispersions.key_source import KeySource
from rpojax.dispersions.kinds.derived import Derived
from rpojax.dispersions.kinds.dispersion_kind import DispersionKind
from rpojax.scenario import params as parameters
from rpojax.scenario.dispersed_numbers.dispersion_keys import (
    assigned_parts,
    design_keys,
    evaluation_order,
    is_common,
    nominal_numbers,
    varied_keys,
)
from rpojax.scenario.former_fault import former_name
from rpojax.scenario.parameter_keys import ParameterKey, nominal_value, parse_key
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile

Values = dict[str, Array]
"""Value by key, in the unit of the key."""


Arrays = dict[str, dict[str, Any]]
"""Numbers of a scenario from which values are drawn: those of each dispersion by its name, nominal ones by key."""

_NOMINAL = "nominal"


def draw_numbers(file: ScenarioFile) -> Arrays:
    """Nominal numbers, and settings of the dispersions, which a compiled program is given."""
    used = [parse_key(term.key).key for entry in file.dispersions if isinstance(entry, Derived) for term in entry.terms]
    nominal = {key: nominal_value(file, ParameterKey(key, None)) for key in [*varied_keys(file), *used]}
    numbers: Arrays = {_NOMINAL: {key: np.asarray(value, dtype=np.float64) for key, value in nominal.items()}}
    for entry in evaluation_order(file):
        settings = {} if isinstance(entry, Derived) else entry.setting_arrays()
        numbers[f"dispersion {entry.name}"] = {**settings, _NOMINAL: nominal_numbers(file, entry)}
    return numbers


def draw(
    file: ScenarioFile,
    run_key: Array,
    assigned: Mapping[str, Array],
    team_key: Array | None = None,
    numbers: Arrays | None = None,
) -> Values:
    """Values of all dispersed keys of one run, or of one servicer of a team.

    Random numbers depend on the run's key and the dispersion's name, so that adding a dispersion leaves the others
    unchanged. `assigned` is this run's part of a design: values by key, or coordinates in (0, 1) by dispersion name.
    With `team_key`, that of a team's run, dispersions that are common to its servicers depend on that one. `numbers`
    are by default those of the scenario; a program that is given them serves all scenarios that differ in them alone.
    """
    values: Values = {}
    numbers = draw_numbers(file) if numbers is None else numbers
    for text in design_keys(file):
        _set_value(numbers, values, parse_key(text), assigned[text])
    entries = evaluation_order(file)
    names = [entry.name for entry in entries]
    for entry, name, key in zip(entries, names, _keys_of_entries(entries, run_key, team_key), strict=True):
        own = numbers[f"dispersion {entry.name}"]
        nominal = jnp.asarray(own[_NOMINAL])
        if isinstance(entry, Derived):
            value = entry.value(
                nominal.shape, [_value_of(numbers, values, parse_key(term.key)) for term in entry.terms]
            )
        else:
            source = CoordinateSource(assigned[name]) if name in assigned else KeySource(key)
            value = entry.draw_with({name: own[name] for name in own if name != _NOMINAL}, nominal, source)
        for parameter, part in assigned_parts(file, entry, value):
            _set_value(numbers, values, parameter, part)
    return values


def _keys_of_entries(entries: Sequence[DispersionKind], run_key: Array, team_key: Array | None) -> Array:
    """(n, 2) random keys of dispersions of a servicer, or of its team for those that are common."""
    names = [entry.name for entry in entries]
    own = _random_keys(random_streams.fold_in(run_key, Stream.DISPERSION), names)
    if team_key is None:
        return own
    common = np.array([is_common(entry) for entry in entries], dtype=bool)
    return jnp.where(common[:, None], _random_keys(random_streams.fold_in(team_key, Stream.DISPERSION), names), own)


def _random_keys(stream: Array, names: Sequence[str]) -> Array:
    """(n, 2) random keys of dispersions by their names."""
    numbers = np.array([zlib.crc32(former_name(name).encode()) & 0x7FFFFFFF for name in names], dtype=np.uint32)
    return random_streams.fold_in_per_key(jnp.broadcast_to(stream, (len(names), 2)), jnp.asarray(numbers))


def _set_value(numbers: Arrays, values: Values, parameter: ParameterKey, value: Array) -> None:
    """Enters a value or a component of one, whose other components stay as they are, or nominal."""
    if parameter.index is None:
        values[parameter.key] = value
    else:
        whole = _whole_value(numbers, values, parameter)
        values[parameter.key] = whole.at[parameter.index].set(value)


def _value_of(numbers: Arrays, values: Values, parameter: ParameterKey) -> Array:
    """Value of a key in the run, nominal if nothing has set it."""
    value = _whole_value(numbers, values, parameter)
    return value if parameter.index is None else value[parameter.index]


def _whole_value(numbers: Arrays, values: Values, parameter: ParameterKey) -> Array:
    """Value of a whole key in the run, nominal if nothing has set it."""
    key = parameter.key
    return values[key] if key in values else jnp.asarray(numbers[_NOMINAL][key])


def apply_to_params(params: Params, values: Values) -> Params:
    """Parameters of one run: nominal ones with the dispersed values."""
    for key, value in values.items():
        path, factor = parameters.leaf_path_and_factor(key, params)
        params = parameters.replace_leaf(params, path, value * factor)
    return params


def read_back(params: Params, keys: list[str]) -> Values:
    """Values that `params` holds for the keys, in the unit of the key."""
    values: Values = {}
    for key in keys:
        path, factor = parameters.leaf_path_and_factor(key, params)
        values[key] = parameters.get_leaf(params, path) / factor
    return values
