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

from rpojax.dispersions.designs.design_kinds import IndependentDesign
from rpojax.dispersions.dispersion_kinds import (
    Choice,
    CorrelatedNormal,
    Derived,
    Dispersion,
    LogNormal,
    Normal,
    SmallRotation,
    TruncatedNormal,
    Uniform,
)
from rpojax.dispersions.random_source import UNIT_MARGIN
from rpojax.dispersions.semidefinite_cholesky import cholesky_factor
from rpojax.errors import ScenarioError
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.dispersed_numbers.dispersed_values import Values
from rpojax.scenario.dispersed_numbers.dispersion_keys import (
    assigned_keys,
    coordinate_count,
    design_keys,
    dispersion_name,
)
from rpojax.scenario.parameter_keys import ParameterKey, expand_vectors, nominal_value, parse_key
from rpojax.scenario.schema import ScenarioFile

_COORDINATE_NAMES = {"direction": ("height", "azimuth"), "attitude": ("share", "first angle", "second angle")}


@dataclass(frozen=True)
class StandardNormalSpace:
    """Standard normal variables of a scenario.

    Attributes:
        file: the scenario
        mapped: dispersions that are functions of the variables, in the order of the variables
        unmapped: names of the others, without derived ones
    """

    file: ScenarioFile
    mapped: tuple[Dispersion, ...]
    unmapped: tuple[str, ...]

    @property
    def dimension(self) -> int:
        """Number of variables."""
        return len(self._varying)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Name of each variable, such as `initial.relative_position_m[0]`."""
        names = [name for entry in self.mapped for name in _labels(self.file, entry)]
        return tuple(names[index] for index in self._varying)

    @cached_property
    def groups(self) -> tuple[str, ...]:
        """Input to which each variable belongs: its label, or the name of an inseparable dispersion."""
        groups = []
        for entry in self.mapped:
            name, rows = dispersion_name(entry), self.slices[dispersion_name(entry)]
            groups += [name if _is_inseparable(entry) else label for label in self.labels[rows]]
        return tuple(groups)

    def group_of(self, column: str) -> str | None:
        """Input to which a dispersed number such as `target.tumble_axis[2]` belongs; None if it is not mapped."""
        if column in self.groups:
            return column
        key = parse_key(column).key
        for entry in self.mapped:
            if _is_inseparable(entry) and any(parameter.key == key for parameter in assigned_keys(entry)):
                return dispersion_name(entry)
        return None

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Variables of each mapped dispersion, by its name."""
        slices, first = {}, 0
        for entry in self.mapped:
            size = int(_varying_coordinates(self.file, entry).sum())
            slices[dispersion_name(entry)] = slice(first, first + size)
            first += size
        return slices

    def values_at(self, z: Float[Array, " n"], key: Array) -> Values:
        """Values of all dispersed keys, in their units, at the variables `z` for the random key of a run."""
        sizes = [coordinate_count(self.file, entry) for entry in self.mapped]
        normals = jnp.zeros(sum(sizes), dtype=jnp.float64).at[self._varying].set(z)
        coordinates = jnp.clip(ndtr(normals), UNIT_MARGIN, 1.0 - UNIT_MARGIN)
        ends = np.cumsum([0, *sizes])
        assigned = {
            dispersion_name(entry): coordinates[first:end]
            for entry, first, end in zip(self.mapped, ends[:-1], ends[1:], strict=True)
        }
        return dispersed_values.draw(self.file, key, assigned)

    @cached_property
    def _varying(self) -> np.ndarray:
        """Indices of the coordinates that have an effect; those of a zero sigma have none."""
        return np.flatnonzero(np.concatenate([_varying_coordinates(self.file, entry) for entry in self.mapped]))


def make_space(file: ScenarioFile) -> StandardNormalSpace:
    """Standard normal variables of a scenario.

    Raises:
        ScenarioError: a table or grid design assigns values, or no dispersion can be mapped.
    """
    if design_keys(file):
        raise ScenarioError("design.kind", file.design.kind, "a design whose values the dispersions draw")
    random = [entry for entry in file.dispersions if not isinstance(entry, Derived)]
    mapped = tuple(entry for entry in random if _is_continuous(file, entry) and _varying_coordinates(file, entry).any())
    if not mapped:
        names = [dispersion_name(entry) for entry in file.dispersions]
        raise ScenarioError("dispersions", names, "at least one that varies without steps, so that it can be moved")
    unmapped = tuple(dispersion_name(entry) for entry in random if not _is_continuous(file, entry))
    return StandardNormalSpace(file, mapped, unmapped)


def with_fixed_values(space: StandardNormalSpace, values: Mapping[str, Any]) -> ScenarioFile:
    """The scenario with every mapped dispersion replaced by a choice of one value, from `values` by key.

    Nominal values, from which the flight software is configured, stay.
    """
    entries: list[Dispersion] = []
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


def _is_inseparable(entry: Dispersion) -> bool:
    """Whether the variables of a dispersion do not correspond to its components one by one."""
    return isinstance(entry, CorrelatedNormal | SmallRotation) or entry.kind in _COORDINATE_NAMES


def _is_continuous(file: ScenarioFile, entry: Dispersion) -> bool:
    """Whether a dispersion is a continuous function of coordinates, with values that a scenario can prescribe."""
    matrix = any(np.ndim(nominal_value(file, parameter)) > 1 for parameter in assigned_keys(entry))
    return not isinstance(entry, Choice) and not matrix


def _varying_coordinates(file: ScenarioFile, entry: Dispersion) -> np.ndarray:
    """(coordinates,) bool, whether a coordinate of a dispersion has an effect."""
    count = coordinate_count(file, entry)
    match entry:
        case CorrelatedNormal():
            return np.any(cholesky_factor(np.array(entry.covariance)) != 0.0, axis=0)
        case Uniform():
            return np.full(count, entry.low < entry.high)
        case SmallRotation():
            return np.broadcast_to(np.asarray(entry.sigma_deg) > 0.0, (count,))
        case Normal() | TruncatedNormal() | LogNormal():
            return np.broadcast_to(np.ravel(entry.sigma) > 0.0, (count,))
        case _:
            return np.ones(count, dtype=bool)


def _labels(file: ScenarioFile, entry: Dispersion) -> list[str]:
    """Name of each coordinate of a dispersion."""
    name, count = dispersion_name(entry), coordinate_count(file, entry)
    if isinstance(entry, CorrelatedNormal):
        return [str(parameter) for parameter in expand_vectors(file, entry.keys)]
    if entry.kind in _COORDINATE_NAMES:
        return [f"{name} ({axis})" for axis in _COORDINATE_NAMES[entry.kind]]
    single = np.ndim(nominal_value(file, parse_key(name))) == 0
    return [name] if single else [f"{name}[{index}]" for index in range(count)]
