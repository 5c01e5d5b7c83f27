"""Start of a scenario from files: epoch, orbit of the target and relative state of the servicer, and what was read."""

import hashlib
import math
import xml.etree.ElementTree as ElementTree
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from rpojax.errors import ScenarioError
from rpojax.scenario.loading.starts import ephemeris_message, mean_elements
from rpojax.scenario.loading.starts.orbit_states import OrbitState, orbit_section, relative_state
from rpojax.untrusted.file_reading import FileError, FileKind, read_bytes
from rpojax.untrusted.text_reading import EncodingError, decode_text

_LARGEST_XML_BYTES: Final = 1_000_000


def resolve_start(tables: dict[str, Any]) -> dict[str, Any]:
    """Reads the files that the section `start` names, and completes the scenario by what they say.

    It sets `epoch_utc`, `orbit`, with a file of the servicer `initial`, and in `start` what was read. A section that
    holds that already is left as it is.

    Returns:
        Tables of the keys of orbits that it sets.

    Raises:
        ScenarioError: a file cannot be read, or is no OEM, OMM or element set.
    """
    start = tables.get("start")
    if not isinstance(start, dict) or "target_sha256" in start or not isinstance(start.get("target"), str):
        return {}
    epoch = _epoch(start.get("epoch_utc"))
    target, digest = _read(Path(start["target"]), epoch, "start.target")
    tables["epoch_utc"] = target.epoch.isoformat()
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


def _epoch(value: Any) -> datetime | None:
    if value is None:
        return None
    try:
        moment = value if isinstance(value, datetime) else datetime.fromisoformat(value)
    except (TypeError, ValueError):
        raise ScenarioError("start.epoch_utc", value, "a date and time such as '2026-03-20T14:46:00'") from None
    return moment if moment.tzinfo is None else moment.astimezone(UTC).replace(tzinfo=None)


def _record(who: str, state: OrbitState, digest: str) -> dict[str, Any]:
    return {
        f"{who}_sha256": digest,
        f"{who}_format": state.kind,
        f"{who}_object": state.name,
        f"{who}_frame": state.frame,
        f"{who}_position_m": state.position_m.tolist(),
        f"{who}_velocity_m_s": state.velocity_m_s.tolist(),
    }


def _read(path: Path, epoch: datetime | None, key: str) -> tuple[OrbitState, str]:
    """State of a file at an epoch, by default its own, and the file's SHA-256."""
    try:
        content = read_bytes(path, FileKind.ORBIT_MESSAGE)
        text = decode_text(content)
    except (FileError, EncodingError) as error:
        raise ScenarioError(key, f"{path} ({error.found})", "a readable OEM, OMM or element set") from None
    try:
        found = _state(text, epoch, key, path)
        if not all(map(math.isfinite, orbit_section(found).values())):
            raise ValueError
        return found, hashlib.sha256(content).hexdigest()
    except (ArithmeticError, ValueError, RecursionError) as error:
        found = f"{path} ({type(error).__name__})"
        raise ScenarioError(key, found, "states from which an orbit can be computed") from None


def _state(text: str, epoch: datetime | None, key: str, path: Path) -> OrbitState:
    first = text.lstrip()[:200]
    if first.startswith("CCSDS_OEM_VERS"):
        return ephemeris_message.state_of(text, epoch, key)
    if first.startswith("CCSDS_OMM_VERS"):
        return mean_elements.from_fields(_keywords(text), epoch, key)
    if first.startswith("<"):
        return mean_elements.from_fields(_xml_fields(text, key), epoch, key)
    if mean_elements.is_two_line(text):
        return mean_elements.from_two_lines(text, epoch, key)
    raise ScenarioError(key, str(path), "an OEM or OMM in key-value notation, an OMM in XML, or two-line elements")


def _keywords(text: str) -> dict[str, str]:
    lines = [line.partition("=") for line in text.splitlines() if "=" in line and not line.startswith("COMMENT")]
    # Units in brackets may follow a value.
    return {name.strip(): value.partition("[")[0].strip() for name, _, value in lines}


def _xml_fields(text: str, key: str) -> dict[str, str]:
    """Texts of the elements of the one OMM of an XML file, which may define no entities of its own."""
    if len(text) > _LARGEST_XML_BYTES or "<!" in text.replace("<!--", ""):
        raise ScenarioError(key, "a large XML file or one with a document type", "the XML of one OMM")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ScenarioError(key, f"XML with {error}"[:100], "the XML of one OMM") from None
    segments = [element for element in root.iter() if element.tag.rpartition("}")[2] == "segment"]
    if len(segments) != 1:
        raise ScenarioError(key, f"{len(segments)} segments", "the XML of one OMM")
    return {element.tag.rpartition("}")[2]: (element.text or "").strip() for element in segments[0].iter()}
