"""Checks of what varies in a team: common or own errors, designs, and values that dispersions replace."""

from collections.abc import Iterator, Mapping
from typing import Any

from rpojax.dispersions.designs.design_sections import LatinHypercubeDesign, SobolDesign
from rpojax.dispersions.kinds.derived import Derived
from rpojax.dispersions.kinds.dispersion_kind import DispersionKind
from rpojax.errors import MISSING, ScenarioError, ServicerError
from rpojax.scenario.dispersed_numbers.dispersion_keys import (
    assigned_keys,
    design_keys,
    is_common,
    is_of_team,
    random_dispersions,
)
from rpojax.scenario.parameter_keys import nominal_of_key, parse_key
from rpojax.scenario.schema import ScenarioFile


def check_dispersions_of_team(file: ScenarioFile) -> None:
    """Checks what varies from run to run in a team of servicers.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    for index, entry in enumerate(file.dispersions):
        _check_common(f"dispersions.{index}", entry)
    if len(file.servicers) > 1 and isinstance(file.design, LatinHypercubeDesign | SobolDesign):
        for entry in random_dispersions(file):
            if not is_common(entry):
                expected = f"another design, as each servicer draws {entry.name} on its own"
                raise ScenarioError("design.kind", file.design.kind, expected)
    for key, value, name in _set_keys(file):
        if what := _replacement(file, key, value):
            expected = f"no value beside {what}, which replaces it in every run"
            raise ServicerError(name, ScenarioError(key, value, expected))


def _check_common(where: str, entry: DispersionKind) -> None:
    """Refuses a number of the world that would differ between servicers."""
    of_team = [str(key) for key in assigned_keys(entry) if is_of_team(key)]
    own = [str(key) for key in assigned_keys(entry) if not is_of_team(key)]
    if isinstance(entry, Derived):
        own = [term.key for term in entry.terms if not is_of_team(parse_key(term.key))]
        if of_team and own:
            expected = f"terms that all servicers have in common, as they have {entry.key}"
            raise ScenarioError(f"{where}.terms", own[0], expected)
        if entry.common is not None:
            raise ScenarioError(f"{where}.common", entry.common, "nothing: a derived value follows its terms")
    elif entry.common is False and of_team:
        raise ScenarioError(f"{where}.common", False, f"true, as all servicers have {of_team[0]} in common")
    elif entry.common is None and of_team and own:
        expected = f"true, as all servicers have {of_team[0]} in common, but not {own[0]}"
        raise ScenarioError(f"{where}.common", MISSING, expected)


def _set_keys(file: ScenarioFile) -> Iterator[tuple[str, Any, str]]:
    """Keys that servicers change, with value and name of the servicer."""
    for changes in file.servicers:
        for key, value in _leaves(changes.tables, ""):
            yield key, value, changes.name


def _leaves(table: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _replacement(file: ScenarioFile, key: str, value: Any) -> str | None:
    """What gives every run another value than that of a servicer, None if nothing does."""
    entries = [entry for entry in file.dispersions if not entry.uses_nominal]
    found = [(parameter, f"the {entry.kind} dispersion") for entry in entries for parameter in assigned_keys(entry)]
    found += [(parse_key(text), f"the {file.design.kind} of the design") for text in design_keys(file)]
    for parameter, what in found:
        if parameter.key != key:
            continue
        if parameter.index is None or value[parameter.index] != nominal_of_key(file, key)[parameter.index]:
            return f"{what} of {parameter}"
    return None
