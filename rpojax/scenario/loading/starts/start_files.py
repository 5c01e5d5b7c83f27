"""Start of a scenario from files: epoch, orbit of the target and relative state of the servicer, and what was read."""

import hashlib
import math
import warnings
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.errors import Notice, ScenarioError
from rpojax.scenario.loading.starts import ephemeris_message, mean_elements, message_text, parameter_message
from rpojax.scenario.loading.starts.orbit_states import OrbitState, check_bound, orbit_section, relative_state
from rpojax.time_scales import Instant, instant
from rpojax.untrusted.file_reading import FileError, FileKind, is_regular, read_bytes
from rpojax.untrusted.text_reading import EncodingError, decode_text

_FEW_COMMAS = 3
"""The first line of a table of orbits has more."""
_SET_BY = {
    "target": ("epoch_utc", "orbit"),
    "servicer": ("initial.relative_position_m", "initial.relative_velocity_m_s"),
}
"""Keys, and a section, that each file of a start sets."""
_OF_MEAN_ELEMENTS = ("TLE", "OMM")


def check_nothing_is_set_beside(files: Sequence[Mapping[str, Any]]) -> None:
    """Refuses what a start would replace in the scenario file that names its files, or in one that extends it.

    Args:
        files: tables of each scenario file, those of one after those that it extends

    Raises:
        ScenarioError: a key is set in vain.
    """
    for who, keys in _SET_BY.items():
        naming = [index for index, each in enumerate(files) if who in _section(each, "start")]
        read = any(f"{who}_sha256" in _section(each, "start") for each in files)
        for each in files[naming[0] :] if naming and not read else ():
            for key in keys:
                section, _, leaf = key.partition(".")
                value = _section(each, section).get(leaf) if leaf else each.get(section)
                if value is not None:
                    instead = "start.epoch_utc" if key == "epoch_utc" else "none"
                    raise ScenarioError(key, str(value), f"{instead} beside start.{who}, whose file says it")


def _section(tables: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = tables.get(name)
    return found if isinstance(found, dict) else {}


def resolve_start(tables: dict[str, Any]) -> dict[str, Any]:
    """Reads the files that the section `start` names, and completes the scenario by what they say.

    It sets `epoch_utc`, `orbit`, with a file of the servicer `initial`, and in `start` what was read. A section that
    holds that already is left as it is.

    Returns:
        Tables of the keys of orbits that it sets.

    Raises:
        ScenarioError: a file cannot be read, or is no OEM, OMM, OPM or element set.
    """
    start = tables.get("start")
    if not isinstance(start, dict) or not isinstance(start.get("target"), str):
        return {}
    if "target_sha256" in start:
        _tell_what_changed(start)
        return {}
    epoch = _epoch(start.get("epoch_utc"))
    target, digest = _read(Path(start["target"]), epoch, "start.target")
    tables["epoch_utc"] = target.epoch.utc()
    tables["orbit"] = orbit_section(target)
    changes: dict[str, Any] = {"orbit": dict(tables["orbit"])}
    start |= _record("target", target, digest)
    if isinstance(start.get("servicer"), str):
        servicer, digest = _read(Path(start["servicer"]), target.epoch, "start.servicer")
        for who, state in (("target", target), ("servicer", servicer)):
            if state.kind in _OF_MEAN_ELEMENTS:
                found = f"{state.kind} beside a file of the {'servicer' if who == 'target' else 'target'}"
                expected = "OEM or OPM of both, since mean elements are off by kilometres"
                raise ScenarioError(f"start.{who}", found, expected)
        if servicer.name == target.name:
            note = f"start.servicer: {servicer.name:.60} is the name of the target, too; are both states of one object?"
            warnings.warn(f"warning: {note}", Notice, stacklevel=2)
        position, velocity = relative_state(servicer, target)
        changes["initial"] = {"relative_position_m": position, "relative_velocity_m_s": velocity}
        tables["initial"] = {**tables.get("initial", {}), **changes["initial"]}
        start |= _record("servicer", servicer, digest)
    return changes


def _tell_what_changed(start: Mapping[str, Any]) -> None:
    """Tells which files have changed since they were read; the scenario keeps what they held then."""
    for who in _SET_BY:
        path = start.get(who)
        if not isinstance(path, str) or f"{who}_sha256" not in start or not is_regular(Path(path)):
            continue
        if hashlib.sha256(_content(Path(path), f"start.{who}")).hexdigest() != start[f"{who}_sha256"]:
            note = f"warning: start.{who}: {path} is not the file of {who}_sha256; the orbit of the latter is used"
            warnings.warn(note, Notice, stacklevel=2)


def _epoch(value: Any) -> Instant | None:
    if value is None:
        return None
    try:
        return instant(value.isoformat() if isinstance(value, date) else value)
    except TypeError:
        raise ScenarioError("start.epoch_utc", value, "a date and time such as '2026-03-20T14:46:00'") from None
    except ValueError as error:
        raise ScenarioError("start.epoch_utc", value, str(error)) from None


def _record(who: str, state: OrbitState, digest: str) -> dict[str, Any]:
    error = state.interpolation_error_m
    return {
        f"{who}_sha256": digest,
        f"{who}_format": state.kind,
        f"{who}_object": state.name,
        f"{who}_frame": state.frame,
        f"{who}_position_m": state.position_m.tolist(),
        f"{who}_velocity_m_s": state.velocity_m_s.tolist(),
        **({} if error is None else {f"{who}_interpolation_error_m": error}),
    }


def _read(path: Path, epoch: Instant | None, key: str) -> tuple[OrbitState, str]:
    """State of a file at an epoch, by default its own, and the file's SHA-256."""
    content = _content(path, key)
    try:
        text = decode_text(content)
    except EncodingError as error:
        raise _unreadable(path, error, key) from None
    try:
        with np.errstate(all="ignore"):  # what is not finite is refused
            found = _state(text, epoch, key, path)
            check_bound(found.position_m, found.velocity_m_s, key)
            elements = orbit_section(found)
        if not all(map(math.isfinite, elements.values())):
            raise ValueError
        return found, hashlib.sha256(content).hexdigest()
    except (ArithmeticError, ValueError, RecursionError) as error:
        found = f"{path} ({type(error).__name__})"
        raise ScenarioError(key, found, "states from which an orbit can be computed") from None


def _content(path: Path, key: str) -> bytes:
    try:
        return read_bytes(path, FileKind.ORBIT_MESSAGE)
    except FileError as error:
        raise _unreadable(path, error, key) from None


def _unreadable(path: Path, error: FileError | EncodingError, key: str) -> ScenarioError:
    return ScenarioError(key, f"{path} ({error.found})", "a readable OEM, OMM, OPM or element set")


def _state(text: str, epoch: Instant | None, key: str, path: Path) -> OrbitState:
    if message_text.is_message(text):
        segments = message_text.read_message(text, key)
        if not segments or segments[0].kind == "OEM":
            return ephemeris_message.state_of(segments, epoch, key)
        of_one = mean_elements.from_message if segments[0].kind == "OMM" else parameter_message.state_of
        return of_one(segments[0], epoch, key)
    if mean_elements.is_two_line(text):
        return mean_elements.from_two_lines(text, epoch, key)
    found = f"{path} ({_looks_like(text)})"
    raise ScenarioError(key, found, "an OEM, OMM or OPM in key-value notation or XML, or two-line elements")


def _looks_like(text: str) -> str:
    """What a file that is no orbit message looks like."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if not lines:
        return "an empty file"
    if lines[0][0] in "[{":
        return "JSON"
    if lines[0].count(",") > _FEW_COMMAS:
        return "a table in CSV"
    if [line[:2] for line in lines[-2:]] == ["1 ", "2 "]:
        return "element lines that do not begin in the first column"
    return f"{lines[0]!r:.60} in its first line"
