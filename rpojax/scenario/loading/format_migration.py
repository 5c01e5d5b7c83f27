"""Versions of the format of scenario files, and the migration of older ones.

| version | what changed |
|---|---|
| 1 | files without `format_version` |
| 2 | three keys of `navigation` count seconds and no longer frames |
| 3 | `chamber_pressure.enabled` measures the pressure, not `effects.faults`; a tolerance of `navigation` is an angle |
| 4 | a list `[[faults]]` in place of one `[fault]` |
"""

import math
import warnings
from collections.abc import Mapping
from typing import Any, Final

from rpojax.errors import ScenarioError
from rpojax.scenario import former_fault
from rpojax.scenario.schema import FORMAT_VERSION

_COUNTED_FRAMES: Final = {
    "confirm_frames": ("confirm_within_s", -1),
    "confirm_tolerance_px": ("confirm_tolerance_px_s", 1),
    "rejections_before_recovery": ("recovery_after_s", -1),
}
"""Former key of `navigation` -> present key, and the power of the camera rate that it is multiplied with."""


class FormatChangeWarning(UserWarning):
    """A scenario file of an older format was migrated; the text says what changed."""


def migrate(tables: dict[str, Any], base: Mapping[str, Any], source: str) -> None:
    """Brings the tables of one file to the present format, with a warning that says what changed.

    Args:
        tables: of the file, changed in place
        base: of the files that it extends, merged
        source: of the file, for messages

    Raises:
        ScenarioError: the format is unknown, or a former key has another one beside it.
    """
    found = tables.get("format_version", 1)
    if not isinstance(found, int) or isinstance(found, bool) or not 1 <= found <= FORMAT_VERSION:
        expected = f"a version from 1 to {FORMAT_VERSION}, the one that this version of rpojax writes"
        raise ScenarioError("format_version", found, expected)
    changes = _changes(tables, base, found)
    if changes:
        warnings.warn(
            f"{source}: format {found} read as {FORMAT_VERSION}: {'; '.join(changes)}", FormatChangeWarning, 2
        )
    tables["format_version"] = FORMAT_VERSION


def migrate_recorded(tables: dict[str, Any]) -> bool:
    """Brings the scenario of a stored campaign to the present format, in place; whether it was of an older one."""
    found = tables.get("format_version")
    if not isinstance(found, int) or isinstance(found, bool) or not 1 <= found < FORMAT_VERSION:
        return False
    _changes(tables, {}, found)
    tables["format_version"] = FORMAT_VERSION
    return True


def _changes(tables: dict[str, Any], base: Mapping[str, Any], found: int) -> list[str]:
    """Migrates tables of the format `found`, in place; what was changed."""
    changes = _seconds_for_frames(tables, base) if found < 2 else []
    changes += _pressure_with_faults(tables, base) if found < 3 else []
    changes += _angle_for_pixels(tables, base) if found < 3 else []
    changes += _list_of_faults(tables, base) if found < 4 else []
    return changes


def _seconds_for_frames(tables: dict[str, Any], base: Mapping[str, Any]) -> list[str]:
    navigation = tables.get("navigation")
    if not isinstance(navigation, dict):
        return []
    rate, changes = _camera_rate(tables, base), list[str]()
    for former, (present, power) in _COUNTED_FRAMES.items():
        if former not in navigation:
            continue
        if present in navigation:
            raise ScenarioError(f"navigation.{former}", navigation[former], f"it or {present}, not both")
        value = navigation.pop(former)
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise ScenarioError(f"navigation.{former}", value, "a number")
        navigation[present] = float(value) * rate**power
        changes.append(f"navigation.{former} = {value:g} became {present} = {navigation[present]:g} at {rate:g} Hz")
    return changes


def _pressure_with_faults(tables: dict[str, Any], base: Mapping[str, Any]) -> list[str]:
    effects, sensor = tables.get("effects"), tables.get("chamber_pressure", {})
    if not isinstance(effects, dict) or effects.get("faults") is not True or not isinstance(sensor, dict):
        return []
    if "enabled" in sensor or base.get("chamber_pressure", {}).get("enabled") is True:
        return []
    tables["chamber_pressure"] = {**sensor, "enabled": True}
    return ["chamber_pressure.enabled = true was added, which effects.faults = true meant"]


def _angle_for_pixels(tables: dict[str, Any], base: Mapping[str, Any]) -> list[str]:
    """Replaces a rate in pixels by the angle that it has in the middle of the image."""
    navigation, former, present = tables.get("navigation"), "confirm_tolerance_px_s", "confirm_tolerance_deg_s"
    if not isinstance(navigation, dict) or former not in navigation:
        return []
    if present in navigation:
        raise ScenarioError(f"navigation.{former}", navigation[former], f"it or {present}, not both")
    value = navigation.pop(former)
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise ScenarioError(f"navigation.{former}", value, "a number")
    width, field_of_view = (_camera_number(name, tables, base) for name in ("width_px", "field_of_view_deg"))
    tangent = 2.0 * value * math.tan(0.5 * math.radians(field_of_view)) / width
    navigation[present] = math.degrees(tangent)
    camera = f"a camera of {width:g} pixels and {field_of_view:g} deg"
    return [f"navigation.{former} = {value:g} became {present} = {navigation[present]:.4g} by {camera}"]


def _list_of_faults(tables: dict[str, Any], base: Mapping[str, Any]) -> list[str]:
    """Makes the one fault of a file the list of that fault, and of those of the files that it extends."""
    parts = ("fault", "servicers", "dispersions", "design")
    before = {name: tables.get(name) for name in parts}
    own = tables.pop("fault", {})
    if not isinstance(own, dict):
        raise ScenarioError("fault", own, "a list [[faults]]")
    for name in ("dispersions", "design"):
        if name in tables:
            tables[name] = former_fault.with_present_keys(tables[name])
    if isinstance(servicers := tables.get("servicers"), list):
        tables["servicers"] = [_with_faults(each) for each in servicers]
    if before == {name: tables.get(name) for name in parts}:
        return []
    faults = [each for each in tables.get("faults", base.get("faults", [])) if isinstance(each, dict)]
    known = next((each for each in faults if each.get("name") == former_fault.NAME), {})
    entry = {"name": former_fault.NAME, **former_fault.NOMINAL, **known, **own}
    tables["faults"] = [each for each in faults if each is not known] + [entry]
    return [f"[fault] became [[faults]] with name = {former_fault.NAME!r}, its keys faults.{former_fault.NAME}.KEY"]


def _with_faults(servicer: Any) -> Any:
    """Table of a servicer with the changes of its one fault by the name of that."""
    if not isinstance(servicer, dict) or "fault" not in servicer:
        return servicer
    rest = {name: value for name, value in servicer.items() if name != "fault"}
    return {**rest, "faults": {former_fault.NAME: servicer["fault"]}}


def _camera_number(name: str, *layers: Mapping[str, Any]) -> float:
    """Number of the camera of the first layer that has it.

    Raises:
        ScenarioError: none has it.
    """
    for tables in layers:
        camera = tables.get("camera")
        value = camera.get(name) if isinstance(camera, dict) else None
        if isinstance(value, int | float) and not isinstance(value, bool) and value > 0.0:
            return float(value)
    raise ScenarioError("navigation.confirm_tolerance_px_s", "pixels", f"camera.{name} in the file, which scales them")


def _camera_rate(*layers: Mapping[str, Any]) -> float:
    """Camera rate [Hz] of the first layer that has one."""
    for tables in layers:
        rates = tables.get("rates")
        rate = rates.get("camera_hz") if isinstance(rates, dict) else None
        if isinstance(rate, int | float) and rate > 0.0:
            return float(rate)
    return 1.0
