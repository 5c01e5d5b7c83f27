"""Nested tables of scenario files: a file merged into its base, and `KEY=VALUE` overrides."""

import functools
from collections.abc import Mapping
from typing import Any

from rpojax.errors import ScenarioError
from rpojax.scenario import former_keys
from rpojax.scenario.checks.nearest_key import is_known_key, nearest_key
from rpojax.scenario.checks.validation_errors import did_you_mean
from rpojax.sensors.additional.registry import sensor_names
from rpojax.untrusted.structure_limits import StructureError
from rpojax.untrusted.toml_reading import MOST_KEY_PARTS, parse_toml

_OPTIONAL_SECTIONS = (
    "initial.handover", "wide_lens", "lamp", "chamber_pressure", "isolation", "plume", "mission", "goal", "link",
    "team", "gps_differences", "link_range",
)  # fmt: skip
"""Sections that a scenario may leave out, and that overrides may make; validation knows their keys."""
_NAMED = {"faults": "fault", "phases": "phase", "servicers": "servicer", "thrusters": "thruster"}
"""Lists of tables with names, by which overrides find them, and what one of them is."""
REMOVED = "none"
"""In place of a kind: the dispersion of the base is removed."""


def merge(base: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """The tables of `base` with `changes` merged in key by key; lists and the design are replaced as a whole.

    Dispersions of `changes` replace those of the same key or keys, or remove them if their kind is `none`; the others
    are appended.

    Raises:
        ScenarioError: a dispersion that `base` does not have is removed.
    """
    merged = dict(base)
    for key, value in changes.items():
        old = merged.get(key)
        if key == "dispersions" and isinstance(old, list) and isinstance(value, list):
            merged[key] = _merge_dispersions(old, value)
        elif key != "design" and isinstance(old, dict) and isinstance(value, dict):
            merged[key] = merge(old, value)
        else:
            merged[key] = value
    return merged


def _merge_dispersions(base: list[Any], changes: list[Any]) -> list[Any]:
    known, changed = [dispersion_name(entry) for entry in base], [dispersion_name(entry) for entry in changes]
    added = []
    for name, entry in zip(changed, changes, strict=True):
        if not (isinstance(entry, dict) and entry.get("kind") == REMOVED):
            added.append(entry)
        elif name not in known:
            raise ScenarioError("dispersions", name, f"a dispersion of the base{did_you_mean(name, known)}")
    return [entry for name, entry in zip(known, base, strict=True) if name not in changed] + added


def key_names(entry: Any) -> list[str]:
    """Keys of the table of a dispersion."""
    keys = (entry.get("keys") or [entry.get("key")]) if isinstance(entry, dict) else []
    return [str(key) for key in keys] if isinstance(keys, list) else []


def dispersion_name(entry: Any) -> str:
    """Name of the table of a dispersion: the key, or the keys joined by `+`."""
    return "+".join(key_names(entry))


def apply_override(tables: dict[str, Any], override: str) -> dict[str, Any]:
    """Sets one key of a section or of an additional sensor in place; its value is TOML, or text if it is no TOML.

    `dispersions.NAME` is the dispersion of that key: `none` removes it, a table replaces it or adds one, and
    `dispersions.NAME.SETTING` is one of its settings.

    Returns:
        Nested tables of the sections with what is set, without dispersions.

    Raises:
        ScenarioError: the text is no `KEY=VALUE`, or there is no such key.
    """
    key, equals, text = override.partition("=")
    key, text = key.strip(), text.strip()
    if not equals or not key or not text or key.count(".") >= MOST_KEY_PARTS:
        raise ScenarioError("overrides", override, "KEY=VALUE, such as navigation.gate_sigma=4", is_argument=True)
    value = _override_value(override, text)
    *path, leaf = key.split(".")
    if path and path[0] == "dispersions":
        _override_dispersion(tables, key.partition(".")[2], value)
        return {}
    if path and path[0] in sensor_names():
        # The section of an additional sensor may be made by overrides alone; validation knows its keys.
        tables.setdefault(path[0], {})[leaf] = value
    elif any(key == name or key.startswith(f"{name}.") for name in _OPTIONAL_SECTIONS) and path:
        functools.reduce(lambda table, name: table.setdefault(name, {}), path, tables)[leaf] = value
    elif len(path) > 1 and path[0] in _NAMED:
        _set_of_named(tables, key, path, leaf, value)
    else:
        _set_existing(tables, key, path, leaf, value)
    return functools.reduce(lambda inner, name: {name: inner}, reversed(path), {leaf: value})


def _override_value(override: str, text: str) -> Any:
    """Value of an override: one in TOML, or the text itself if it is one line and no TOML."""
    try:
        found = parse_toml(f"value = {text}")
    except StructureError:
        if "\n" in text or "\r" in text:
            raise ScenarioError("overrides", override, "KEY=VALUE in one line", is_argument=True) from None
        return text
    if len(found) > 1:
        raise ScenarioError("overrides", override, "one KEY=VALUE, no line after it", is_argument=True)
    return found["value"]


def _set_of_named(tables: dict[str, Any], key: str, path: list[str], leaf: str, value: Any) -> None:
    """Sets a key of the phase or servicer of a name; those that it may leave out are made, and so is a fault."""
    of_list, name, *inner = path
    if of_list == "faults" and all(each.get("name") != name for each in tables.get(of_list) or []):
        tables[of_list] = [*(tables.get(of_list) or []), {"name": name}]
    entries = [each for each in tables.get(of_list) or [] if isinstance(each, dict)]
    names = [str(each.get("name")) for each in entries]
    if name not in names:
        expected = f"the name of a {_NAMED[of_list]} of the scenario{did_you_mean(name, names)}"
        raise ScenarioError("overrides", key, expected, is_argument=True)
    table: Any = entries[names.index(name)]
    for part in inner:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise ScenarioError("overrides", key, f"a table at {part}", is_argument=True)
    table[leaf] = value


def _set_existing(tables: dict[str, Any], key: str, path: list[str], leaf: str, value: Any) -> None:
    table: Any = tables
    for name in path:
        table = table.get(name) if isinstance(table, dict) else None
    if not isinstance(table, dict) or not (leaf in table or (path and is_known_key(key))):
        if present := former_keys.replacement(key):
            raise ScenarioError(key, value, present, is_argument=True)
        raise ScenarioError("overrides", key, f"a key of the scenario{nearest_key(key)}", is_argument=True)
    table[leaf] = value


def _override_dispersion(tables: dict[str, Any], text: str, value: Any) -> None:
    """Removes, replaces or adds the dispersion of the name `text`, or sets one that exists of its settings."""
    entries = tables.get("dispersions")
    entries = entries if isinstance(entries, list) else []
    names = [dispersion_name(entry) for entry in entries]
    name, _, setting = text.rpartition(".")
    keys = {"keys": text.split("+")} if "+" in text else {"key": text}
    if text in names and value == REMOVED:
        del entries[names.index(text)]
    elif text in names and isinstance(value, dict):
        entries[names.index(text)] = keys | value
    elif name in names and setting in entries[names.index(name)]:
        entries[names.index(name)][setting] = value
    elif text not in names and isinstance(value, dict):
        tables["dispersions"] = [*entries, keys | value]
    else:
        if text in names:
            expected = "'none', or a table such as {kind = 'normal', sigma = 1.0}"
        else:
            expected = f"a dispersion of the scenario, or one of its settings{did_you_mean(text, names)}"
        raise ScenarioError("overrides", f"dispersions.{text}={value}", expected, is_argument=True)
