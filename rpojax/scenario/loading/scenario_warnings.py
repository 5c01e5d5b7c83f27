"""All warnings about a scenario: about its mission, and about keys that a user gave and that have no effect in it.

A key counts as given where its value is not that of the packaged scenario from which the file comes: the one with which
it agrees in most keys. So a complete file, such as that in the folder of a campaign, says as much as a short one.
"""

import functools
import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from rpojax.printable_text import shown_value
from rpojax.scenario.dispersed_numbers.dispersion_keys import design_keys
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.parameter_keys import parse_key
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import member_files
from rpojax.scenario.team.team_warnings import mission_warnings
from rpojax.scenario.warnings.key_uses import Situation, unused_keys

_BASE_OF_ALL = "inspection"
_ROUNDING = 1e-9
"""Relative difference of numbers that were converted, or tuned without effect."""


@dataclass(frozen=True)
class _Setting:
    """What a scenario has of a key that has no effect.

    Attributes:
        path: of the key, of that of a servicer, or of a dispersion
        value: as the content of a scenario has it
        shown: in a warning
        needs: what would give it an effect
    """

    path: str
    value: Any
    shown: Any
    needs: str


def scenario_warnings(file: ScenarioFile, replaced: Collection[str] = ()) -> list[str]:
    """One line for each reason for which a scenario may not do what it says: key, found, expected.

    Stages are `replaced` beside those of the scenario's plugin.
    """
    return [*mission_warnings(file), *bad_side_warnings(file), *unused_key_warnings(file, replaced)]


def bad_side_warnings(file: ScenarioFile) -> list[str]:
    """One line for each metric of a plugin of which only values on the side that it calls good violate requirements."""
    found: list[str] = []
    for name, metric in plugin_registry.metrics_of(file).items():
        bounds = {entry.bound for entry in file.requirements if entry.metric == name}
        if metric.source == "plugin" and bounds == {"at most" if metric.low_is_bad else "at least"}:
            side = "high" if metric.low_is_bad else "low"
            found.append(
                f"requirements: found {name!r} {bounds.pop()!r}, expected `low_is_bad={not metric.low_is_bad}` of "
                f"`rpojax.metric`, since tables and comparisons take its {side} values for the better ones"
            )
    return found


def unused_key_warnings(file: ScenarioFile, replaced: Collection[str] = ()) -> list[str]:
    """One line for each key that was given or is dispersed and has no effect: its value, and what would use it."""
    content = _content(file)
    stages = plugin_registry.replaced_stages(file, replaced)
    found = [each for each in _without_effect(file, content, stages) if _is_given(each, [_packaged(_BASE_OF_ALL)])]
    if found:
        # Loading all packaged scenarios takes a tenth of a second.
        bases = _nearest(content)
        found = [each for each in found if _is_given(each, bases)]
    return [
        f"{each.path}: found {shown_value(each.shown)}, which has no effect, expected {each.needs} beside it"
        for each in found
    ]


def _without_effect(file: ScenarioFile, content: Mapping[str, Any], replaced: frozenset[str]) -> Iterator[_Setting]:
    """Everything in a scenario that has no effect, whether a user gave it or not.

    What servicers have in common has none if it has none for each of them.
    """
    of_each = [unused_keys(Situation(member, bool(file.servicers), replaced)) for member in member_files(file)]
    of_all = {key: needs for key, needs in of_each[0].items() if all(key in unused for unused in of_each)}
    for key, needs in of_all.items():
        if key in content:
            yield _Setting(key, content[key], content[key], needs)
    for changes, unused in zip(file.servicers, of_each, strict=False):
        for key, needs in unused.items():
            if (path := f"servicers.{changes.name}.{key}") in content:
                yield _Setting(path, content[path], content[path], needs)
    for entry in file.dispersions:
        path = f"dispersions.{entry.name}"
        for key in dict.fromkeys(parse_key(text).key for text in entry.key_texts):
            if key in of_all:
                yield _Setting(path, content[path], entry.kind, of_all[key])
        if entry.common is not None and not file.servicers:
            yield _Setting(f"{path}.common", entry.common, entry.common, "[[servicers]]")
    for text in design_keys(file):
        if (key := parse_key(text).key) in of_all:
            path = f"design.values.{text}"
            yield _Setting(path, content[path], content[path], of_all[key])


def _content(file: ScenarioFile) -> dict[str, Any]:
    """Values of a scenario by key; those of servicers and phases by their names, dispersions by their keys."""
    tables = file.model_dump()
    found = dict(_leaves({name: value for name, value in tables.items() if isinstance(value, dict)}, ""))
    for phase in file.phases:
        # Of a phase without a packaged one of its name only the defaults say what was not given.
        found |= _leaves(phase.model_dump(exclude_defaults=True), f"phases.{phase.name}.")
    for fault in file.faults:
        found |= _leaves(fault.model_dump(exclude_defaults=True), f"faults.{fault.name}.")
    for changes in file.servicers:
        found |= _leaves(changes.tables, f"servicers.{changes.name}.")
    return found | {
        f"dispersions.{entry.name}": table for entry, table in zip(file.dispersions, tables["dispersions"], strict=True)
    }


def _leaves(table: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in table.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _is_given(setting: _Setting, bases: Iterable[Mapping[str, Any]]) -> bool:
    """Whether a value is none of some contents; that of a servicer may be any servicer's there, or that of all."""
    own = setting.path.split(".", 2)
    key = own[2] if own[0] == "servicers" else None
    for base in bases:
        known = [base.get(setting.path)] if key is None else [base.get(key)]
        if key is not None:
            known += [value for path, value in base.items() if path.split(".", 2)[::2] == ["servicers", key]]
        if any(_agrees(setting.value, each) for each in known):
            return False
    return True


def _agrees(one: Any, other: Any) -> bool:
    match one, other:
        case list(), list():
            return len(one) == len(other) and all(map(_agrees, one, other))
        case float(), float():
            return math.isclose(one, other, rel_tol=_ROUNDING)
        case _:
            return one == other


@functools.cache
def _packaged(name: str) -> dict[str, Any]:
    return _content(scenario_loader.load(name))


def _nearest(content: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Contents of the packaged scenarios that agree with a content in most keys."""
    every = [_packaged(name) for name in scenario_loader.packaged_names()]
    agreeing = [sum(key in base and _agrees(value, base[key]) for key, value in content.items()) for base in every]
    return [base for base, count in zip(every, agreeing, strict=True) if count == max(agreeing)]
