"""Keys of the numbers of a scenario, such as `servicer.mass_kg`, and of single components, such as `KEY[1]`."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.physics.equipment_faults import kind_code
from rpojax.scenario.numbers.number_sections import is_variable
from rpojax.scenario.schema import ScenarioFile
from rpojax.sensors.additional.additional_sensor import AdditionalSensor
from rpojax.value_types import Section

_COMPONENT = re.compile(r"(.+)\[([0-9]{1,3})\]")


@dataclass(frozen=True)
class ParameterKey:
    """Key of a number, vector or matrix of a scenario, or of one component of a vector.

    Attributes:
        key: such as `servicer.mass_kg`
        index: of the component, None for the whole value
    """

    key: str
    index: int | None

    def overlaps(self, other: "ParameterKey") -> bool:
        """Whether the two have a number in common."""
        return self.key == other.key and (self.index == other.index or None in (self.index, other.index))

    def __str__(self) -> str:
        return self.key if self.index is None else f"{self.key}[{self.index}]"


def parse_key(text: str) -> ParameterKey:
    """Key written as `servicer.mass_kg` or `formation.desired_position_m[1]`."""
    component = _COMPONENT.fullmatch(text)
    return ParameterKey(component[1], int(component[2])) if component else ParameterKey(text, None)


def nominal_value(file: ScenarioFile, parameter: ParameterKey) -> Any:
    """Nominal value as numbers, None if the scenario has no number of that key that may be dispersed."""
    value = nominal_of_key(file, parameter.key)
    if value is None or parameter.index is None:
        return value
    return value[parameter.index] if np.ndim(value) == 1 and parameter.index < len(value) else None


def section_of_key(file: ScenarioFile, key: str) -> tuple[Section | None, str]:
    """Section of a key such as `servicer.mass_kg`, None if the scenario has none of that name; and the name in it."""
    path, _, name = key.rpartition(".")
    section: Any = file
    for part in path.split("."):
        section = _inner_section(section, part)
        if not isinstance(section, Section | list):
            return None, name
    return (section if isinstance(section, Section) else None), name


def _inner_section(section: Any, part: str) -> Any:
    """The section of a name in another one, or in the list of phases; None without one of that name."""
    if isinstance(section, list):
        return next((phase for phase in section if phase.name == part), None)
    return getattr(section, part, None) if part in type(section).model_fields else None


def nominal_of_key(file: ScenarioFile, key: str) -> Any:
    """Nominal value of a whole key; a fault kind as its code."""
    section, name = section_of_key(file, key)
    if section is None or name not in type(section).model_fields or (section is file.mission and not file.phases):
        return None
    value = getattr(section, name)
    if isinstance(section, AdditionalSensor):
        return None if isinstance(value, str | int | Section) else value
    if not is_variable(type(section), name):
        return None
    return float(kind_code(value)) if isinstance(value, str | int) else value


def expand_vectors(file: ScenarioFile, texts: Sequence[str]) -> list[ParameterKey]:
    """Keys of single numbers; the key of a vector stands for its components."""
    expanded: list[ParameterKey] = []
    for parameter in map(parse_key, texts):
        value = nominal_value(file, parameter)
        if np.ndim(value):
            expanded += [ParameterKey(parameter.key, index) for index in range(np.size(value))]
        else:
            expanded.append(parameter)
    return expanded


def component_columns(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Values (runs, ...) by key as one column (runs,) per number; vectors give `KEY[0]`, `KEY[1]`, ..."""
    columns: dict[str, np.ndarray] = {}
    for key, rows in values.items():
        parts = rows.reshape(len(rows), -1).T
        names = [key] if rows.ndim == 1 else [f"{key}[{index}]" for index in range(len(parts))]
        columns.update(zip(names, parts, strict=True))
    return columns
