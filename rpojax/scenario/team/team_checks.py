"""Checks of a team: names, starts, links, what must be equal for all servicers, and dispersions of a team."""

import math
from collections.abc import Iterator
from itertools import combinations
from typing import Any, Final

import numpy as np

from rpojax.errors import MISSING, ScenarioError, ServicerError
from rpojax.physics.plant_options import is_category
from rpojax.scenario.checks.consistency_checks import check_consistency
from rpojax.scenario.dispersed_numbers.dispersion_keys import varied_keys
from rpojax.scenario.schema import ScenarioFile, ServicerChanges
from rpojax.scenario.team import dispersion_rules
from rpojax.scenario.team.members import member_files, member_names
from rpojax.scenario.team.team_options import burn_period_s, decision_unit_s

_LEAST_DISTANCE_M: Final = 0.1
"""Between two servicers at the start [m]."""
_SECTIONS: Final = tuple(name for name in ServicerChanges.model_fields if name not in ("name", "decision_offset_s"))
_FREE: Final = frozenset({"timeout_s", "keep_out_m", "position_weight", "velocity_weight", "delta_v_weight"})
"""Keys of phases that one servicer may have and another one not."""
_EQUAL_NUMBERS: Final = frozenset({"control_period_s", "decision_period_s", "common_share"})
_EQUAL_BELIEF: Final = "difference_"
"""Begin of the keys of the belief in differences of GPS positions, which is that of a pair."""


def check_team(file: ScenarioFile) -> None:
    """Checks the servicers of a team and their links, or that a servicer alone has no settings of a team.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    if not file.servicers:
        _check_alone(file)
        return
    names = member_names(file)
    for name in names:
        if names.count(name) > 1:
            raise ScenarioError("servicers.name", name, "a name that no other servicer has")
    members = member_files(file)
    for name, member in zip(names, members, strict=True):
        try:
            check_consistency(member)
        except ScenarioError as error:
            raise ServicerError(name, error) from None
    for name, member in zip(names[1:], members[1:], strict=True):
        _check_alike(names[0], members[0], name, member)
    _check_starts(names, members)
    _check_offsets(file)
    _check_link(file)
    _check_guidance(file)
    dispersion_rules.check_dispersions_of_team(file)


def _check_alone(file: ScenarioFile) -> None:
    expected = "it only in a scenario with [[servicers]]"
    if file.navigation.sharing != "none":
        raise ScenarioError("navigation.sharing", file.navigation.sharing, expected)
    for name in ("link", "team", "gps_differences", "link_range"):
        if getattr(file, name) != type(file).model_fields[name].get_default():
            raise ScenarioError(name, "settings", "them only in a scenario with [[servicers]]")
    for key in varied_keys(file):
        if key.startswith(("link.", "team.", "gps_differences.", "link_range.", "navigation.difference_")):
            raise ScenarioError("dispersions", key, expected)


def _check_alike(of_first: str, first: ScenarioFile, name: str, member: ScenarioFile) -> None:
    """Refuses a servicer for which another program would be compiled than for the first one."""
    # A goal is a matter of judgement alone.
    compared = set(_SECTIONS) - {"goal"}
    own, others = member.model_dump(include=compared), first.model_dump(include=compared)
    for key, found, expected in _differences(own, others, ""):
        raise ServicerError(name, ScenarioError(key, found, f"{expected} as servicer {of_first!r} has it"))


def _differences(own: dict[str, Any], others: dict[str, Any], path: str) -> Iterator[tuple[str, Any, str]]:
    """Key, what was found and what was expected, where two servicers differ in more than a number."""
    for key in {**own, **others}:
        where, found, expected = f"{path}{key}", own.get(key), others.get(key)
        if key in ("faults", "phases"):
            for part, other in zip(own[key], others[key], strict=True):
                yield from _differences(part, other, f"{where}.{part['name']}.")
        elif isinstance(found, dict) and isinstance(expected, dict):
            yield from _differences(found, expected, f"{where}.")
        elif key in _FREE or is_category(where) or path.endswith("until."):
            continue
        elif found is None or expected is None:
            yield where, MISSING if found is None else found, "no value" if expected is None else "a value"
        elif _must_be_equal(key, found) and found != expected:
            yield where, found, repr(expected)
        elif _shape(found) != _shape(expected):
            yield where, found, f"numbers of shape {_shape(expected)}"


def _must_be_equal(key: str, value: Any) -> bool:
    return isinstance(value, str | int) or key in _EQUAL_NUMBERS or key.startswith(_EQUAL_BELIEF)


def _shape(value: Any) -> tuple[int, ...]:
    return np.shape(value)


def _check_starts(names: tuple[str, ...], members: tuple[ScenarioFile, ...]) -> None:
    for (of_first, first), (name, member) in combinations(zip(names, members, strict=True), 2):
        place = member.initial.relative_position_m
        if math.dist(place, first.initial.relative_position_m) < _LEAST_DISTANCE_M:
            expected = f"a start at least {_LEAST_DISTANCE_M:g} m from that of servicer {of_first!r}"
            raise ServicerError(name, ScenarioError("initial.relative_position_m", place, expected))


def _check_offsets(file: ScenarioFile) -> None:
    unit, period = decision_unit_s(file), burn_period_s(file)
    for changes in file.servicers:
        offset = changes.decision_offset_s
        if offset is None:
            continue
        if offset >= period or not _is_multiple(offset, unit):
            expected = f"a whole number of {unit:g} s below {period:g} s, the time between two burn decisions"
            raise ServicerError(changes.name, ScenarioError("decision_offset_s", offset, expected))


def _check_link(file: ScenarioFile) -> None:
    link, names, camera_s = file.link, member_names(file), 1.0 / file.rates.camera_hz
    for key, value in (("link.period_s", link.period_s), ("link.delay_s", link.delay_s)):
        if not _is_multiple(value, camera_s):
            raise ScenarioError(key, value, f"a whole number of camera periods ({camera_s:g} s)")
    for pair in link.hears or []:
        unknown = [name for name in pair if name not in names]
        if unknown:
            raise ScenarioError("link.hears", unknown[0], f"the name of a servicer, one of {', '.join(names)}")
        if pair[0] == pair[1] or (link.hears or []).count(pair) > 1:
            raise ScenarioError("link.hears", pair, "two servicers, and each pair once")
    if file.navigation.sharing == "none":
        return
    hearing = names if link.hears is None else tuple(receiver for receiver, _ in link.hears)
    for name in names:
        if len(names) == 1 or name not in hearing:
            found, expected = f"{name!r} hears nobody", "links to each servicer, or navigation.sharing = 'none'"
            raise ScenarioError("link.hears", found, expected)


def _check_guidance(file: ScenarioFile) -> None:
    """Checks what the guidance of a team needs: messages, phases, and starts that are far enough from each other."""
    keep_out, phasing = file.team.keep_out_m, file.team.phasing
    if not keep_out and "team.keep_out_m" in varied_keys(file):
        raise ScenarioError("team.keep_out_m", keep_out, "above 0, as it is dispersed")
    for key, value, is_used in (
        ("team.keep_out_m", keep_out, keep_out > 0.0),
        ("team.phasing", phasing, phasing != "fixed"),
    ):
        if is_used and file.navigation.sharing == "none":
            expected = "navigation.sharing beside it, as messages tell where the others are"
            raise ScenarioError(key, value, expected)
        if is_used and not file.phases:
            raise ScenarioError(key, value, "phases beside it, in which burns are planned so")
    if phasing != "fixed" and not any(phase.reference.kind == "relative_orbit" for phase in file.phases):
        raise ScenarioError("team.phasing", phasing, "a phase with a reference of kind 'relative_orbit'")
    if not keep_out:
        return
    places = [each.initial.relative_position_m for each in member_files(file)]
    for (of_first, first), (name, place) in combinations(zip(member_names(file), places, strict=True), 2):
        if math.dist(first, place) <= keep_out:
            expected = f"a start farther than team.keep_out_m = {keep_out:g} from that of servicer {of_first!r}"
            raise ServicerError(name, ScenarioError("initial.relative_position_m", place, expected))


def _is_multiple(value: float, unit: float) -> bool:
    return math.isclose(value / unit, round(value / unit), rel_tol=1e-9, abs_tol=1e-9)
