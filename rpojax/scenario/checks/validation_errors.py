"""Errors of the schema validation as one-line scenario errors."""

import difflib
from collections.abc import Mapping
from typing import Any, get_args

from pydantic import ValidationError

from rpojax.errors import MISSING, ScenarioError, UnknownKeyError
from rpojax.scenario import former_keys
from rpojax.scenario.checks.nearest_key import nearest_key
from rpojax.scenario.schema import ScenarioFile


def first_error(error: ValidationError, tables: Mapping[str, Any]) -> ScenarioError:
    """The first fault that pydantic reports of `tables`: the key's path, what was found and what was expected."""
    faults = error.errors()
    first = _key_path(faults[0]["loc"])
    # For a key that takes a number or a list pydantic reports a fault of each; the deepest one fits the value given.
    related = [fault for fault in faults if _key_path(fault["loc"])[: len(first)] == first]
    fault = max(related, key=lambda fault: len(_key_path(fault["loc"])))
    key = ".".join(_with_name(_key_path(fault["loc"]), tables))
    if fault["type"] == "extra_forbidden" and _is_of_world(fault["loc"]):
        expected = f"it only at the top of the scenario: one {fault['loc'][2]} for all servicers"
        return ScenarioError(key, "a value", expected)
    if fault["type"] == "extra_forbidden":
        if present := former_keys.replacement(key):
            return ScenarioError(key, fault["input"], present)
        return UnknownKeyError(key, _similar_key(key, fault["loc"]))
    if fault["type"] == "missing":
        return ScenarioError(key, MISSING, "a value for this key")
    if fault["type"] == "union_tag_invalid" and fault["loc"][0] == "phases":
        context = fault.get("ctx", {})
        return ScenarioError(f"{key}.kind", context["tag"], f"one of {context['expected_tags']}")
    if fault["type"] == "too_long" and isinstance(fault["input"], list):
        most = fault.get("ctx", {})["max_length"]
        return ScenarioError(key, f"{len(fault['input'])} of them", f"at most {most}")
    if fault["type"] == "too_short" and isinstance(fault["input"], list):
        return ScenarioError(key, fault["input"], f"at least {fault.get('ctx', {})['min_length']} numbers")
    if fault["type"] in ("model_type", "model_attributes_type"):
        return ScenarioError(key, fault["input"], "a table")
    message = fault["msg"].removeprefix("Value error, ").removeprefix("Input should be ").removeprefix("expected ")
    return ScenarioError(key, fault["input"], message)


def _key_path(location: tuple[int | str, ...]) -> list[str]:
    """Path of a key as in the file, without the names that pydantic gives to the members of a union."""
    branch = {"dispersions": 2, "design": 1}.get(str(location[0])) if location else None
    if location[:1] == ("phases",) and location[2:3] == ("reference",):
        branch = 3
    parts = [part for index, part in enumerate(location) if index != branch]
    return [str(part) for part in parts if not str(part).startswith(("constrained-", "list["))]


def _with_name(path: list[str], tables: Mapping[str, Any]) -> list[str]:
    """Path of a key with the name of a phase or fault, where it has one, in place of its number."""
    parts = tables.get(path[0]) if path[:1] in (["phases"], ["faults"]) else None
    if len(path) < 2 or not path[1].isdecimal() or not isinstance(parts, list):
        return path
    part = parts[int(path[1])]
    name = part.get("name") if isinstance(part, dict) else None
    # A fault of the name itself is told with the number.
    return [path[0], name, *path[2:]] if isinstance(name, str) and name and path[2:] != ["name"] else path


def _is_of_world(location: tuple[int | str, ...]) -> bool:
    """Whether a servicer of a team changes what is a key of the scenario, but not of a servicer."""
    return location[0] == "servicers" and len(location) == 3 and location[2] in ScenarioFile.model_fields


def _similar_key(key: str, location: tuple[int | str, ...]) -> str:
    """Hint at the nearest known key; in a list of tables, at a key of the same table."""
    fields, *path = ScenarioFile.model_fields, *location
    if not any(isinstance(part, int) for part in location):
        return nearest_key(key)
    if path[0] == "servicers" and len(path) > 3:
        path = path[2:]
    if len(path) > 1 and path[0] in fields:
        annotation = fields[str(path[0])].annotation
        section = next(iter(get_args(annotation)), annotation)
        names = list(getattr(section, "model_fields", {}))
    else:
        names = list(fields)
    return did_you_mean(str(path[-1]), names)


def did_you_mean(unknown: str, names: list[str]) -> str:
    """Hint such as ` (did you mean 'mass_kg'?)`, empty if no name is similar."""
    close = difflib.get_close_matches(unknown, names, n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""
