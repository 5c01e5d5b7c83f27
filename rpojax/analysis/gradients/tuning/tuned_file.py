"""Text of a tuned scenario: a file that extends the one that was tuned, with the numbers that differ alone."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from rpojax.errors import RpojaxError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import FORMAT_VERSION, ScenarioFile


def extending_text(tuned: ScenarioFile, source: str, path: Path) -> str | None:
    """TOML of a file at `path` that extends `source`, a packaged name or a file, and gives the scenario `tuned`.

    None where the difference is more than values of keys, or the source cannot be read.
    """
    try:
        base = scenario_loader.load(source, allow_plugin=False).model_dump(mode="json", exclude_none=True)
    except RpojaxError:
        return None
    changes = _changes(base, tuned.model_dump(mode="json", exclude_none=True))
    if changes is None:
        return None
    extends = source if source in scenario_loader.packaged_names() else _relative(Path(source), path.parent)
    return tomli_w.dumps({"format_version": FORMAT_VERSION, "extends": extends, **changes})


def _changes(base: Mapping[str, Any], wanted: Mapping[str, Any]) -> dict[str, Any] | None:
    """Nested keys of `wanted` whose values are not those of `base`; None if a list of tables or a key more differs."""
    found: dict[str, Any] = {}
    if set(base) - set(wanted):
        return None
    for key, value in wanted.items():
        if isinstance(value, dict) and isinstance(base.get(key), dict):
            inner = _changes(base[key], value)
            if inner is None:
                return None
            found |= {key: inner} if inner else {}
        elif value != base.get(key):
            if isinstance(value, list) and any(isinstance(each, dict) for each in value):
                return None
            found[key] = value
    return found


def _relative(source: Path, folder: Path) -> str:
    """Path of a file as a file in `folder` names it."""
    try:
        return Path(os.path.relpath(source.absolute(), folder.absolute())).as_posix()
    except ValueError:  # on another drive
        return source.absolute().as_posix()
