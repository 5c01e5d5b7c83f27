"""Checks of the values that a table or grid design assigns."""

from typing import Any

import numpy as np

from rpojax.dispersions.designs.design_sections import GridDesign, TableDesign
from rpojax.dispersions.listed_values import check_listed_values
from rpojax.errors import ScenarioError
from rpojax.physics.plant_options import is_category
from rpojax.scenario.dispersed_numbers.assigned_value_checks import (
    check_acceptable,
    check_key_exists,
)
from rpojax.scenario.dispersed_numbers.dispersion_keys import assigned_keys
from rpojax.scenario.parameter_keys import ParameterKey, nominal_of_key, nominal_value, parse_key
from rpojax.scenario.schema import ScenarioFile


def check_design(file: ScenarioFile) -> None:
    """Checks a design: keys that exist and are not dispersed as well, and values that the schema allows.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    design = file.design
    if not isinstance(design, TableDesign | GridDesign):
        return
    if isinstance(design, TableDesign):
        _check_column_lengths(design)
    assigned = [parameter for dispersion in file.dispersions for parameter in assigned_keys(dispersion)]
    for text, values in design.values.items():
        where, parameter = f"design.values.{text}", parse_key(text)
        check_key_exists(file, where, text)
        if any(parameter.overlaps(other) for other in assigned):
            raise ScenarioError("design.values", text, "a key that nothing else gives values to")
        assigned.append(parameter)
        shape = np.shape(nominal_value(file, parameter))
        if shape and isinstance(design, TableDesign):
            raise ScenarioError("design.values", text, f"one column for each component, such as '{text}[0]'")
        check_listed_values(where, text, values, shape)
        for value in _extreme_values(text, values):
            check_acceptable(file, where, parameter, value, whole=bool(shape))
    for key in {parameter.key for parameter in map(parse_key, design.values) if parameter.index is not None}:
        shortest = _shortest_vector(file, design, key)
        check_acceptable(file, f"design.values.{key}", ParameterKey(key, None), shortest, whole=True)


def _check_column_lengths(design: TableDesign) -> None:
    if design.file:
        raise ScenarioError("design.file", design.file, "values, or a file in a scenario that is loaded")
    lengths = {len(values) for values in design.values.values()}
    if len(lengths) != 1 or 0 in lengths:
        raise ScenarioError("design.values", f"columns of {sorted(lengths)} values", "one value or more for each run")


def _extreme_values(text: str, values: list[Any]) -> list[Any]:
    """Values that are acceptable only if all are: the allowed numbers form intervals, so least and greatest suffice."""
    if is_category(text):
        return list(dict.fromkeys(values))
    return [min(values), max(values)] if not isinstance(values[0], list) else values


def _shortest_vector(file: ScenarioFile, design: TableDesign | GridDesign, key: str) -> list[float]:
    """Shortest vector that the assigned components of a key form; the schema's lower bound of a norm holds for all."""
    columns: dict[int, np.ndarray] = {}
    for text, values in design.values.items():
        if (parameter := parse_key(text)).key == key and parameter.index is not None:
            column = np.array(values, dtype=np.float64)
            columns[parameter.index] = column if design.kind == "table" else column[[np.abs(column).argmin()]]
    rows = np.tile(nominal_of_key(file, key), (len(next(iter(columns.values()))), 1))
    for index, column in columns.items():
        rows[:, index] = column
    return rows[np.linalg.norm(rows, axis=1).argmin()].tolist()
