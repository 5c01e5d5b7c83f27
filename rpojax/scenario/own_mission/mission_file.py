"""Text of a scenario file of a mission of one's own, and what of it cannot be flown."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import tomli_w

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.loading.scenario_warnings import scenario_warnings
from rpojax.scenario.loading.table_merging import merge
from rpojax.scenario.own_mission.choices import Choice, Choices, tidy
from rpojax.scenario.own_mission.facts import MissionFacts
from rpojax.scenario.own_mission.lens import lens_choices, lens_problems
from rpojax.scenario.own_mission.orbit_and_light import orbit_of, start_choices
from rpojax.scenario.own_mission.plan import plan_choices
from rpojax.scenario.own_mission.servicer import servicer_area, servicer_choices, times_of
from rpojax.scenario.own_mission.target_outline import (
    Outline,
    outline_of,
    target_area_and_mass,
    target_choices,
)
from rpojax.scenario.schema import FORMAT_VERSION, ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.target_light import unseen_places

BASE, FULL_BASE = "inspection", "inspection_full"
"""Scenarios that the file extends: without and with the full environment."""
_SECTIONS = (
    "", "rates", "orbit", "atmosphere", "initial", "servicer", "servicer_surface", "target", "target_surface",
    "thruster", "wheels", "camera", "navigation", "formation", "pointing", "mission", "limits",
)  # fmt: skip
_DARK_FACTOR = 2.0
"""Time that a mission takes in an orbit with darkness over that of one without."""
_LONGEST_LINE = 120


@dataclass(frozen=True)
class OwnMission:
    """A mission made of what is known.

    Attributes:
        text: of its scenario file
        file: the scenario
        problems: a line for each thing that cannot be flown as asked
    """

    text: str
    file: ScenarioFile
    problems: list[str]


def own_mission(name: str, facts: MissionFacts) -> OwnMission:
    """Scenario of a mission of one's own.

    Raises:
        RpojaxError: what is known does not make a mission.
    """
    extended = FULL_BASE if facts.full_environment else BASE
    base = scenario_loader.read(extended)
    outline = outline_of(facts)
    orbit = orbit_of(facts, base.tables["epoch_utc"])
    times = times_of(facts, orbit.period_s)
    description = _description(facts, outline)
    of_target = target_choices(facts, outline, base.tables["navigation"]) + lens_choices(facts, outline)
    of_target += _ballistic(facts, outline)
    fixed = orbit.choices + servicer_choices(facts, times) + of_target
    if not facts.full_environment:
        fixed = Choices([each for each in fixed.values if not each.is_full], fixed.lists)
    choices = fixed + plan_choices(facts, outline, times, 1.0)
    file = _scenario(base.tables, name, description, choices)
    dark = unseen_places(file, DispersedReach(file), np.array([0.0, -facts.nearest_m, 0.0]))
    if dark.any():
        starts = start_choices(dark)
        factor = 1.0 if starts.light_deg / 360.0 * orbit.period_s > file.duration_s else _DARK_FACTOR
        choices = fixed + plan_choices(facts, outline, times, factor) + starts.choices
        file = _scenario(base.tables, name, description, choices)
    lens = lens_problems(facts, outline, file.camera.field_of_view_deg, file.camera.width_px)
    return OwnMission(_text(name, extended, description, choices), file, [*lens, *scenario_warnings(file)])


def _ballistic(facts: MissionFacts, outline: Outline) -> Choices:
    """Belief of the difference of area over mass of both craft, with the full environment."""
    (area, mass), (own_area, own_mass) = target_area_and_mass(facts, outline), (servicer_area(facts), facts.mass_kg)
    of_target, of_servicer = area / mass, own_area / own_mass
    sigma = abs(of_target - of_servicer) + 0.1 * max(of_target, of_servicer)
    reason = f"{of_target:.3g} of the target less {of_servicer:.3g} of the servicer, and a tenth"
    return Choices([Choice("navigation.ballistic_sigma_m2_kg", tidy(sigma, 2), reason, True)])


def _description(facts: MissionFacts, outline: Outline) -> str:
    way = f"hold at {facts.hold_m:g} m" + (f", approach to {facts.approach_m:g} m" if facts.approach_m else "")
    craft = f"{facts.mass_kg:g} kg and {facts.thrust_n:g} N"
    return f"{craft} at {outline.words}, {facts.altitude_km:g} km: {way}"


def _scenario(base: dict[str, Any], name: str, description: str, choices: Choices) -> ScenarioFile:
    changes: dict[str, Any] = {"name": name, "description": description}
    for each in choices.values:
        section, _, key = each.key.rpartition(".")
        (changes.setdefault(section, {}) if section else changes)[key] = each.value
    for each in choices.lists:
        changes.setdefault(each.key, []).append(each.value)
    return scenario_loader.validate(merge(base, changes))


def _text(name: str, base: str, description: str, choices: Choices) -> str:
    """Text of a file that extends the base."""
    lines = [
        "#:schema ./rpojax.schema.json",
        "# By `rpojax new` from what was known; what was derived says from which number. All other keys are those of",
        f"# the base: `rpojax show {name}.toml` prints each with unit, origin and meaning.",
        "",
        f"format_version = {FORMAT_VERSION}",
        *_assignment("extends", base),
        *_assignment("name", name),
        *_assignment("description", description),
    ]
    for section in _SECTIONS:
        of_section = [each for each in choices.values if each.key.rpartition(".")[0] == section]
        lines += ["", f"[{section}]"] if section and of_section else []
        for each in of_section:
            lines += _assignment(each.key.rpartition(".")[2], each.value, each.reason)
    for each in choices.lists:
        lines += ["", f"[[{each.key}]]" + (f"  # {each.reason}" if each.reason else "")]
        for key, value in each.value.items():
            lines += _assignment(key, value)
    return "\n".join([*lines, ""])


def _assignment(key: str, value: Any, reason: str = "") -> list[str]:
    """Lines of TOML; points of a hull stand four to a line, and a reason that is too long before the key."""
    text = f"{key} = {_value(value)}"
    if isinstance(value, list) and len(value) > 3 and isinstance(value[0], list):
        rows = [", ".join(map(_value, value[start : start + 4])) for start in range(0, len(value), 4)]
        text = "\n".join([f"{key} = [", *(f"  {row}," for row in rows), "]"])
        return [*([f"# {reason}"] if reason else []), text]
    if not reason:
        return [text]
    line = f"{text}  # {reason}"
    return [line] if len(line) <= _LONGEST_LINE else [f"# {reason}", text]


def _value(value: Any) -> str:
    """A value in TOML on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_value(each)}" for key, each in value.items()) + " }"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, float) and math.isfinite(value) and 1e-4 > abs(value) > 0.0:
        return f"{value:g}"
    return tomli_w.dumps({"x": value}).rstrip("\n").partition(" = ")[2]
