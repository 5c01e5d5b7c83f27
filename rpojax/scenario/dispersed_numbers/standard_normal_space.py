"""Transformation of the dispersions of a scenario to independent standard normal variables (Rosenblatt).

Each unit-cube coordinate of a dispersion is Phi(z), so that |z| is the distance from the median in sigmas. Choices and
dispersed matrices are not transformed: they keep the values drawn from the run's random key.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr
from jaxtyping import Array, Float

from rpojax.dispersions.coordinate_source import UNIT_MARGIN
from rpojax.dispersions.designs.design_sections import IndependentDesign
from rpojax.dispersions.kinds.choice import Choice
from rpojax.dispersions.kinds.dispersion_kind import DispersionKind, RandomKind
from rpojax.errors import ScenarioError
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.dispersed_numbers.dispersion_keys import (
    assigned_keys,
    coordinate_count,
    design_keys,
    nominal_numbers,
    random_dispersions,
)
from rpojax.scenario.parameter_keys import ParameterKey, expand_vectors, parse_key
from rpojax.scenario.schema import ScenarioFile


@dataclass(frozen=True)
class StandardNormalSpace:
    """Standard normal variables of a scenario.

    Attributes:
        file: the scenario
        mapped: dispersions that are functions of the variables, in the order of the variables
        unmapped: names of the others, without derived ones
    """

    file: ScenarioFile
    mapped: tuple[RandomKind, ...]
    unmapped: tuple[str, ...]

    @property
    def dimension(self) -> int:
        """Number of variables."""
        return len(self._varying)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Name of each variable, such as `initial.relative_position_m[0]`."""
        names = [
            label
            for entry in self.mapped
            for label in entry.coordinate_labels([str(key) for key in expand_vectors(self.file, entry.key_texts)])
        ]
        return tuple(names[index] for index in self._varying)

    @cached_property
    def groups(self) -> tuple[str, ...]:
        """Input to which each variable belongs: its label, or the name of an inseparable dispersion."""
        groups = []
        for entry in self.mapped:
            labels = self.labels[self.slices[entry.name]]
            groups += labels if entry.is_separable else [entry.name] * len(labels)
        return tuple(groups)

    def group_of(self, column: str) -> str | None:
        """Input to which a dispersed number such as `target.tumble_axis[2]` belongs; None if it is not mapped."""
        if column in self.groups:
            return column
        key = parse_key(column).key
        for entry in self.mapped:
            if not entry.is_separable and any(parameter.key == key for parameter in assigned_keys(entry)):
                return entry.name
        return None

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Variables of each mapped dispersion, by its name."""
        slices, first = {}, 0
        for entry in self.mapped:
            size = int(self._varies(entry).sum())
            slices[entry.name] = slice(first, first + size)
            first += size
        return slices

    def values_at(self, z: Float[Array, " n"], key: Array) -> Values:
        """Values of all dispersed keys, in their units, at the variables `z` for the random key of a run."""
        sizes = [coordinate_count(self.file, entry) for entry in self.mapped]
        normals = jnp.zeros(sum(sizes), dtype=jnp.float64).at[self._varying].set(z)
        coordinates = jnp.clip(ndtr(normals), UNIT_MARGIN, 1.0 - UNIT_MARGIN)
        ends = np.cumsum([0, *sizes])
        assigned = {
            entry.name: coordinates[first:end]
            for entry, first, end in zip(self.mapped, ends[:-1], ends[1:], strict=True)
        }
        return dispersed_values.draw(self.file, key, assigned)

    @cached_property
    def _varying(self) -> np.ndarray:
        """Indices of the coordinates that have an effect; those of a zero sigma have none."""
        return np.flatnonzero(np.concatenate([self._varies(entry) for entry in self.mapped]))

    def _varies(self, entry: RandomKind) -> np.ndarray:
        return entry.varies(nominal_numbers(self.file, entry))


def make_space(file: ScenarioFile) -> StandardNormalSpace:
    """Standard normal variables of a scenario.

    Raises:
        ScenarioError: a table or grid design assigns values, or no dispersion can be mapped.
    """
    if design_keys(file):
        raise ScenarioError("design.kind", file.design.kind, "a design whose values the dispersions draw")
    mappable = [entry for entry in random_dispersions(file) if _is_mappable(file, entry)]
    mapped = tuple(entry for entry in mappable if entry.varies(nominal_numbers(file, entry)).any())
    if not mapped:
        names = [entry.name for entry in file.dispersions]
        raise ScenarioError("dispersions", names, "at least one that varies without steps, so that it can be moved")
    unmapped = tuple(entry.name for entry in random_dispersions(file) if entry not in mappable)
    return StandardNormalSpace(file, mapped, unmapped)


def with_fixed_values(space: StandardNormalSpace, values: Mapping[str, Any]) -> ScenarioFile:
    """The scenario with every mapped dispersion replaced by a choice of one value, from `values` by key.

    Nominal values, from which the flight software is configured, stay.
    """
    entries: list[DispersionKind] = []
    for entry in space.file.dispersions:
        if entry in space.mapped:
            entries += [_single_value_choice(parameter, values) for parameter in assigned_keys(entry)]
        else:
            entries.append(entry)
    independent = IndependentDesign(kind="independent")
    return space.file.model_copy(update={"dispersions": entries, "design": independent})


def _single_value_choice(parameter: ParameterKey, values: Mapping[str, Any]) -> Choice:
    value = np.asarray(values[parameter.key])
    chosen = value if parameter.index is None else value[parameter.index]
    return Choice(key=str(parameter), kind="choice", values=[chosen.tolist()])


def _is_mappable(file: ScenarioFile, entry: RandomKind) -> bool:
    """Whether a dispersion is a continuous function of coordinates, with values that a scenario can prescribe."""
    return entry.is_continuous and nominal_numbers(file, entry).ndim <= 1
