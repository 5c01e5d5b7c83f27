"""Start of a scenario from files: epoch, orbit of the target and relative state of the servicer, and what was read."""

import hashlib
import math
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.errors import ScenarioError
from rpojax.scenario.loading.starts import ephemeris_message, mean_elements, message_text, parameter_message
from rpojax.scenario.loading.starts.orbit_states import OrbitState, orbit_section, relative_state
from rpojax.time_scales import Instant, instant
from rpojax.untrusted.file_reading import FileError, FileKind, read_bytes
from rpojax.untrusted.text_reading import EncodingError, decode_text


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
    if not isinstance(start, dict) or "target_sha256" in start or not isinstance(start.get("target"), str):
        return {}
    epoch = _epoch(start.get("epoch_utc"))
    target, digest = _read(Path(start["target"]), epoch, "start.target")
    tables["epoch_utc"] = target.epoch.utc()
    tables["orbit"] = orbit_section(target)
    changes: dict[str, Any] = {"orbit": dict(tables["orbit"])}
    start |= _record("target", target, digest)
    if isinstance(start.get("servicer"), str):
        servicer, digest = _read(Path(start["servicer"]), target.epoch, "start.servicer")
        position, velocity = relative_state(servicer, target)
        changes["initial"] = {"relative_position_m": position, "relative_velocity_m_s": velocity}
        tables["initial"] = {**tables.get("initial", {}), **changes["initial"]}
        start |= _record("servicer", servicer, digest)
    return changes


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
    try:
        content = read_bytes(path, FileKind.ORBIT_MESSAGE)
        text = decode_text(content)
    except (FileError, EncodingError) as error:
        raise ScenarioError(key, f"{path} ({error.found})", "a readable OEM, OMM, OPM or element set") from None
    try:
        with np.errstate(all="ignore"):  # what is not finite is refused
            found = _state(text, epoch, key, path)
            elements = orbit_section(found)
        if not all(map(math.isfinite, elements.values())):
            raise ValueError
        return found, hashlib.sha256(content).hexdigest()
    except (ArithmeticError, ValueError, RecursionError) as error:
        found = f"{path} ({type(error).__name__})"
        raise ScenarioError(key, found, "states from which an orbit can be computed") from None


def _state(text: str, epoch: Instant | None, key: str, path: Path) -> OrbitState:
    if message_text.is_message(text):
        segments = message_text.read_message(text, key)
        if not segments or segments[0].kind == "OEM":
            return ephemeris_message.state_of(segments, epoch, key)
        of_one = mean_elements.from_message if segments[0].kind == "OMM" else parameter_message.state_of
        return of_one(segments[0], epoch, key)
    if mean_elements.is_two_line(text):
        return mean_elements.from_two_lines(text, epoch, key)
    raise ScenarioError(key, str(path), "an OEM, OMM or OPM in key-value notation or XML, or two-line elements")
