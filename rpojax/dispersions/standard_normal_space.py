"""A run's dispersions as independent standard normal numbers z, so that |z| is a distance from the median in sigmas.

Each coordinate of a dispersion is Phi(z), from which `dispersions.draw` makes its value as for a design that fills the
unit cube. Choices and dispersed matrices are no such numbers: they stay what the run draws.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr
from jaxtyping import Array

from rpojax.dispersions import dispersed_values
from rpojax.dispersions.designs import UNIT_MARGIN
from rpojax.dispersions.dispersed_values import Values, cholesky_factor
from rpojax.errors import ScenarioError
from rpojax.scenario import dispersion_keys, schema
from rpojax.scenario.schema import Dispersion, ScenarioFile

_COORDINATE_NAMES = {"direction": ("height", "azimuth"), "attitude": ("share", "first angle", "second angle")}


@dataclass(frozen=True)
class StandardNormalSpace:
    """The numbers that a scenario's dispersions are made from.

    Attributes:
        file: the scenario
        moved: dispersions that are made from the numbers, in the order of the numbers
        held: names of the others, derived ones left out
    """

    file: ScenarioFile
    mapped: tuple[Dispersion, ...]
    unmapped: tuple[str, ...]

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """One name for each number, such as `initial.relative_position_m[0]`."""
        names = [name for entry in self.mapped for name in _labels(self.file, entry)]
        return tuple(names[index] for index in self._varying)

    @cached_property
    def groups(self) -> tuple[str, ...]:
        """For each number the input that it belongs to: its own label, or a dispersion that cannot be taken apart."""
        found = []
        for entry in self.mapped:
            name, rows = dispersion_keys.dispersion_name(entry), self.slices[dispersion_keys.dispersion_name(entry)]
            found += [name if _is_inseparable(entry) else label for label in self.labels[rows]]
        return tuple(found)

    def group_of(self, column: str) -> str | None:
        """Input that a dispersed number such as `target.tumble_axis[2]` belongs to; None for numbers that are held."""
        if column in self.groups:
            return column
        key = dispersion_keys.parse_key(column).key
        for entry in self.mapped:
            if _is_inseparable(entry) and any(where.key == key for where in dispersion_keys.assigned_keys(entry)):
                return dispersion_keys.dispersion_name(entry)
        return None

    @property
    def dimension(self) -> int:
        """How many numbers there are."""
        return len(self._varying)

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Which numbers each moved dispersion is made from, by its name."""
        found, first = {}, 0
        for entry in self.mapped:
            size = int(_varying_coordinates(self.file, entry).sum())
            found[dispersion_keys.dispersion_name(entry)] = slice(first, first + size)
            first += size
        return found

    def values_at(self, numbers: Array, key: Array) -> Values:
        """Values of all dispersed keys in the user's units, from numbers (count,) and the random key of a run."""
        sizes = [dispersion_keys.coordinate_count(self.file, entry) for entry in self.mapped]
        whole = jnp.zeros(sum(sizes), dtype=jnp.float64).at[self._varying].set(numbers)
        shares = jnp.clip(ndtr(whole), UNIT_MARGIN, 1.0 - UNIT_MARGIN)
        ends = np.cumsum([0, *sizes])
        given = {
            dispersion_keys.dispersion_name(entry): shares[first:end]
            for entry, first, end in zip(self.mapped, ends[:-1], ends[1:], strict=True)
        }
        return dispersed_values.draw(self.file, key, given)

    @cached_property
    def _varying(self) -> np.ndarray:
        """Coordinates that change anything: a sigma of zero leaves its coordinate without effect."""
        return np.flatnonzero(np.concatenate([_varying_coordinates(self.file, entry) for entry in self.mapped]))


def make_space(file: ScenarioFile) -> StandardNormalSpace:
    """Numbers behind the dispersions of a scenario.

    Raises:
        ScenarioError: a table or grid gives values, or no dispersion can be moved.
    """
    if dispersion_keys.design_keys(file):
        raise ScenarioError("design.kind", file.design.kind, "a design whose values the dispersions draw")
    drawn = [entry for entry in file.dispersions if not isinstance(entry, schema.Derived)]
    moved = tuple(entry for entry in drawn if _is_continuous(file, entry) and _varying_coordinates(file, entry).any())
    if not moved:
        found = [dispersion_keys.dispersion_name(entry) for entry in file.dispersions]
        raise ScenarioError("dispersions", found, "at least one that varies without steps, so that it can be moved")
    held = tuple(dispersion_keys.dispersion_name(entry) for entry in drawn if not _is_continuous(file, entry))
    return StandardNormalSpace(file, moved, held)


def with_fixed_values(space: StandardNormalSpace, values: Mapping[str, Any]) -> ScenarioFile:
    """The scenario with every moved dispersion as a choice of one value, from `values` by key in the user's units.

    The values do not become nominal ones: flight software would be told of them.
    """
    entries: list[Dispersion] = []
    for entry in space.file.dispersions:
        if entry in space.mapped:
            entries += [_single_value_choice(where, values) for where in dispersion_keys.assigned_keys(entry)]
        else:
            entries.append(entry)
    independent = schema.IndependentDesign(kind="independent")
    return space.file.model_copy(update={"dispersions": entries, "design": independent})


def _single_value_choice(where: dispersion_keys.ParameterKey, values: Mapping[str, Any]) -> schema.Choice:
    value = np.asarray(values[where.key])
    text = where.key if where.index is None else f"{where.key}[{where.index}]"
    chosen = value if where.index is None else value[where.index]
    return schema.Choice(key=text, kind="choice", values=[chosen.tolist()])


def _is_inseparable(entry: Dispersion) -> bool:
    """Whether the numbers of a dispersion are not those of its components."""
    return isinstance(entry, schema.CorrelatedNormal | schema.SmallRotation) or entry.kind in _COORDINATE_NAMES


def _is_continuous(file: ScenarioFile, entry: Dispersion) -> bool:
    """Whether a dispersion is made from numbers without steps, and its values can be chosen by a scenario."""
    matrix = any(
        np.ndim(dispersion_keys.nominal_value(file, where)) > 1 for where in dispersion_keys.assigned_keys(entry)
    )
    return not isinstance(entry, schema.Choice) and not matrix


def _varying_coordinates(file: ScenarioFile, entry: Dispersion) -> np.ndarray:
    """(coordinates,) bool, those of a dispersion that change its value."""
    count = dispersion_keys.coordinate_count(file, entry)
    match entry:
        case schema.CorrelatedNormal():
            return np.any(cholesky_factor(np.array(entry.covariance)) != 0.0, axis=0)
        case schema.Uniform():
            return np.full(count, entry.low < entry.high)
        case schema.SmallRotation():
            return np.broadcast_to(np.asarray(entry.sigma_deg) > 0.0, (count,))
        case schema.Normal() | schema.TruncatedNormal() | schema.LogNormal():
            return np.broadcast_to(np.ravel(entry.sigma) > 0.0, (count,))
        case _:
            return np.ones(count, dtype=bool)


def _labels(file: ScenarioFile, entry: Dispersion) -> list[str]:
    """A name for each coordinate of a dispersion."""
    name, count = dispersion_keys.dispersion_name(entry), dispersion_keys.coordinate_count(file, entry)
    if isinstance(entry, schema.CorrelatedNormal):
        places = dispersion_keys.expand_vectors(file, entry.keys)
        return [place.key if place.index is None else f"{place.key}[{place.index}]" for place in places]
    if entry.kind in _COORDINATE_NAMES:
        return [f"{name} ({axis})" for axis in _COORDINATE_NAMES[entry.kind]]
    single = np.ndim(dispersion_keys.nominal_value(file, dispersion_keys.parse_key(name))) == 0
    return [name] if single else [f"{name}[{index}]" for index in range(count)]
