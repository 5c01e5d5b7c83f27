"""The command `rpojax show`: keys of a scenario with value, unit, origin and meaning."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rpojax.cli.exit_status import Status
from rpojax.cli.options.scenarios import ShowCommand
from rpojax.cli.standard_streams import print_json
from rpojax.runtime.warning_lines import warnings_as_lines
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.loading.format_migration import FormatChangeWarning
from rpojax.scenario.loading.shown_keys import ShownKey, shown_keys

_WIDEST = 36
"""Longest value of a table; one key alone is shown whole."""


def show(asked: ShowCommand) -> int:
    """Does the work of the command; returns its exit status."""
    with warnings_as_lines(FormatChangeWarning):
        found = shown_keys(scenario_loader.read(asked.scenario, asked.overrides), asked.key)
    if asked.as_json:
        print_json({"scenario": asked.scenario, "keys": [_record(each) for each in found]})
    elif len(found) == 1 and found[0].key.count(".") == asked.key.count("."):  # No section of one key.
        print("\n".join(_one(found[0])))
    else:
        print("\n".join(_table(found)))
    return Status.DONE


def _record(key: ShownKey) -> dict[str, Any]:
    content = asdict(key)
    content["before"] = None if key.before is None else {"value": key.before[0], "origin": key.before[1]}
    return content


def _one(key: ShownKey) -> list[str]:
    """Lines on one key."""
    lines = [f"{key.key} = {_text(key.value)}{f' {key.unit}' if key.unit else ''}"]
    replaced = f", in place of {_text(key.before[0])} of {key.before[1]}" if key.before else ""
    lines.append(f"  from: {key.origin}{replaced}")
    for label, text in (("meaning", key.meaning), ("varies", key.varied_by), ("has an effect with", key.needs)):
        if text:
            lines.append(f"  {label}: {text}")
    return lines


def _table(keys: Sequence[ShownKey]) -> list[str]:
    """Lines on many keys, by section: key and value, unit, origin, meaning."""
    sections: dict[str, list[tuple[str, ...]]] = {}
    for each in keys:
        section, name = _place(each.key)
        varied = f" ({each.varied_by})" if each.varied_by else ""
        cells = (name, _cut(_text(each.value)), each.unit or "-", Path(each.origin).name, each.meaning + varied)
        sections.setdefault(section, []).append(cells)
    lines: list[str] = []
    for section, rows in sections.items():
        widths = [max(len(row[column]) for row in rows) for column in range(4)]
        lines += ["", f"[{section}]"] if section else []
        for row in rows:
            name, *filled = [cell.ljust(width) for cell, width in zip(row, widths, strict=False)]
            lines.append(f"{name} = {'  '.join(filled)}  {row[-1]}".rstrip())
    return lines if lines[0] else lines[1:]


def _place(key: str) -> tuple[str, str]:
    """Section and name of a key; a dispersion's name is that of its keys."""
    if key.startswith("dispersions."):
        section, _, name = key.partition(".")
    else:
        section, _, name = key.rpartition(".")
    return section, name


def _text(value: Any) -> str:
    """A value as in TOML, in words where there is none."""
    if value is None:
        return "not given"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_text(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str | bool) else str(value)


def _cut(text: str) -> str:
    return text if len(text) <= _WIDEST else f"{text[: _WIDEST - 4]} ..."
