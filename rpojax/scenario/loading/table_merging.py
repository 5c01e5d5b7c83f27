"""Nested tables of scenario files: a file merged into its base, and `KEY=VALUE` overrides."""

import tomllib
from collections.abc import Mapping
from typing import Any

from rpojax.errors import ScenarioError
from rpojax.scenario.loading.validation_errors import did_you_mean
from rpojax.sensors.additional.registry import sensor_names


def merge(base: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """The tables of `base` with `changes` merged in key by key; lists and the design are replaced as a whole.

    Dispersions of `changes` replace those of the same key or keys, the others are appended.
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
    def name(entry: Any) -> Any:
        return (entry.get("key"), entry.get("keys")) if isinstance(entry, dict) else None

    changed = [name(entry) for entry in changes]
    return [entry for entry in base if name(entry) not in changed] + changes


def apply_override(tables: dict[str, Any], override: str) -> None:
    """Sets one existing key in place, or one of an additional sensor; its value is TOML, or text if it is no TOML.

    Raises:
        ScenarioError: the text is no `KEY=VALUE`, or there is no such key.
    """
    key, equals, text = override.partition("=")
    key, text = key.strip(), text.strip()
    if not equals or not key or not text:
        raise ScenarioError("overrides", override, "KEY=VALUE, such as navigation.gate_sigma=4", is_argument=True)
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text
    *path, leaf = key.split(".")
    if path and path[0] in sensor_names():
        # The section of an additional sensor may be made by overrides alone; validation knows its keys.
        tables.setdefault(path[0], {})[leaf] = value
        return
    table: Any = tables
    for name in path:
        table = table.get(name) if isinstance(table, dict) else None
    if not isinstance(table, dict) or leaf not in table:
        hint = did_you_mean(leaf, list(table)) if isinstance(table, dict) else ""
        raise ScenarioError("overrides", key, f"a key of the scenario{hint}", is_argument=True)
    table[leaf] = value
