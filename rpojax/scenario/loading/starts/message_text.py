"""Orbit messages in key-value notation and in XML, as fields and states by segment; each keyword is judged here."""

import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, cast, get_args

from rpojax.errors import ScenarioError
from rpojax.scenario.loading.starts import message_keywords
from rpojax.scenario.loading.starts.message_keywords import KEYWORDS, VERSIONS, Keyword, MessageKind, Use
from rpojax.time_scales import SCALES, Instant, instant

_LARGEST_XML_BYTES: Final = 16_000_000
_VERSION: Final = re.compile(r"CCSDS_([A-Z]+)_VERS\s*=\s*(\S*)\s*")
_ASSIGNMENT: Final = re.compile(r"([A-Za-z][A-Za-z0-9_]*)\s*=\s*(.*)")
_NUMBER: Final = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(?:\[\s*(.*?)\s*\])?", re.ASCII)
_STATE_NAMES: Final = ("EPOCH", "X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT", "X_DDOT", "Y_DDOT", "Z_DDOT")
_CONTAINERS: Final = frozenset(
    {
        *("ndm", "oem", "omm", "opm", "header", "body", "segment", "metadata", "data", "stateVector"),
        *("meanElements", "tleParameters", "spacecraftParameters", "covarianceMatrix", "keplerianElements"),
        *("maneuverParameters", "userDefinedParameters"),
    }
)
"""Elements of XML that hold others."""


@dataclass(frozen=True)
class Segment:
    """Part of a message with metadata of its own.

    Attributes:
        key: of the file in errors
        kind: of the message
        fields: text by keyword; with the data in OMM and OPM
        rows: words of each state of an OEM, and where it stands
    """

    key: str
    kind: MessageKind
    fields: dict[str, str] = field(default_factory=dict)
    rows: list[tuple[str, list[str]]] = field(default_factory=list)

    def needed(self, name: str) -> str:
        """Text of a keyword.

        Raises:
            ScenarioError: it is missing or empty.
        """
        if not self.fields.get(name):
            raise ScenarioError(self.key, f"no {name}", f"an {self.kind} with it")
        return self.fields[name]

    def check(self, name: str, *expected: str) -> None:
        """Refuses a keyword whose text is none of those expected.

        Raises:
            ScenarioError: it is another or missing.
        """
        if self.needed(name).upper() not in expected:
            raise ScenarioError(self.key, f"{name} = {self.fields[name]:.30}", " or ".join(expected))

    def number(self, name: str) -> float:
        """Number of a keyword in the unit that the standard demands.

        Raises:
            ScenarioError: it is missing, no number, or in another unit.
        """
        text, unit = self.needed(name), KEYWORDS[self.kind][name].unit or ""
        found = number_in(text, unit)
        if found is None:
            raise ScenarioError(self.key, f"{name} = {text:.40}", f"a finite number{unit and f' in {unit}'}")
        return found

    def time(self, name: str) -> Instant:
        """Instant of a keyword in the message's time scale.

        Raises:
            ScenarioError: it is missing or no date, or the scale is not known.
        """
        return self.instant(self.needed(name), self.key, f"{name} = ")

    def instant(self, text: str, where: str, before: str = "") -> Instant:
        """Instant of a text in the message's time scale; `where` stands first in errors, `before` before the text.

        Raises:
            ScenarioError: it is no date with a time of the day, or the scale is not known.
        """
        scale = self.needed("TIME_SYSTEM").upper()
        if scale not in SCALES:
            raise ScenarioError(where, f"TIME_SYSTEM = {scale:.30}", f"one of {', '.join(SCALES)}")
        try:
            if ":" not in text:
                raise ValueError("a date and time such as '2026-03-20T14:46:00'")
            return instant(text, scale)
        except ValueError as error:
            raise ScenarioError(where, f"{before}{text:.60}", str(error)) from None


def number_in(text: str, unit: str) -> float | None:
    """Finite number of a text, which may say its unit in brackets; None if it has none, or another unit."""
    found = _NUMBER.fullmatch(text)
    if found is None or (found[2] or unit).lower() != unit.lower() or not math.isfinite(float(found[1])):
        return None
    return float(found[1])


def read_message(text: str, key: str) -> list[Segment]:
    """Segments of the one orbit message in a text, in key-value notation or XML.

    Raises:
        ScenarioError: it is none, there are several, or a keyword of it is refused, given twice or not known.
    """
    return _from_xml(text, key) if text.lstrip().startswith("<") else _from_lines(text, key)


def is_message(text: str) -> bool:
    """Whether a text begins as an orbit message."""
    start = text.lstrip()[:200]
    return start.startswith("<") or _VERSION.match(start) is not None


def _from_lines(text: str, key: str) -> list[Segment]:
    lines = [
        (number, words)
        for number, line in enumerate(text.splitlines(), start=1)
        if (words := line.strip()) and words.split(maxsplit=1)[0] != "COMMENT"
    ]
    kind = _kind(*_version_of(lines[0][1]), key)
    for number, words in lines[1:]:
        if _VERSION.fullmatch(words):
            raise ScenarioError(f"{key} line {number}", f"another message, {words:.40}", "one message of one object")
    return _oem_segments(lines[1:], key) if kind == "OEM" else [_flat_segment(lines[1:], kind, key)]


def _version_of(words: str) -> tuple[str, str]:
    found = _VERSION.fullmatch(words)
    return (found[1], found[2]) if found else (words, "")


def _kind(name: str, version: str, key: str) -> MessageKind:
    if name not in get_args(MessageKind) or version not in VERSIONS:
        raise ScenarioError(key, f"{name:.20} version {version:.20}", f"OEM, OMM or OPM of {', '.join(VERSIONS)}")
    return cast(MessageKind, name)


def _flat_segment(lines: list[tuple[int, str]], kind: MessageKind, key: str) -> Segment:
    segment = Segment(key, kind)
    for number, words in lines:
        _put(
            segment.fields, *_assignment(words, f"{key} line {number}"), KEYWORDS[kind], (kind, f"{key} line {number}")
        )
    return segment


def _oem_segments(lines: list[tuple[int, str]], key: str) -> list[Segment]:
    segments: list[Segment] = []
    header: dict[str, str] = {}
    block = "HEADER"
    for number, words in lines:
        where = f"{key} line {number}"
        if words in ("META_START", "META_STOP", "COVARIANCE_START", "COVARIANCE_STOP"):
            block = _next_block(block, words, where)
            if words == "META_START":
                segments.append(Segment(key, "OEM"))
        elif block == "STATES" and "=" not in words:
            segments[-1].rows.append((where, words.split()))
        elif block == "HEADER":
            _put(header, *_assignment(words, where), message_keywords.HEADER, ("header of an OEM", where))
        elif block == "META":
            rows = message_keywords.OEM_METADATA
            _put(segments[-1].fields, *_assignment(words, where), rows, ("metadata of an OEM", where))
        elif block == "COVARIANCE" and "=" in words:
            _put({}, *_assignment(words, where), message_keywords.OEM_COVARIANCE, ("covariance of an OEM", where))
        elif block != "COVARIANCE":
            raise ScenarioError(where, words[:60], "a time and six numbers [km, km/s]")
    if block not in ("STATES", "HEADER"):
        raise ScenarioError(key, f"no end of the block {block}", "an OEM with META_STOP and COVARIANCE_STOP")
    return segments


def _next_block(block: str, words: str, where: str) -> str:
    allowed = {
        "META_START": (("HEADER", "STATES"), "META"),
        "META_STOP": (("META",), "STATES"),
        "COVARIANCE_START": (("STATES",), "COVARIANCE"),
        "COVARIANCE_STOP": (("COVARIANCE",), "STATES"),
    }
    before, after = allowed[words]
    if block not in before:
        raise ScenarioError(where, words, "blocks META_START to META_STOP, states, COVARIANCE_START to COVARIANCE_STOP")
    return after


def _assignment(words: str, where: str) -> tuple[str, str]:
    found = _ASSIGNMENT.fullmatch(words)
    if found is None:
        raise ScenarioError(where, words[:60], "KEYWORD = value")
    return found[1], found[2].strip()


def _put(fields: dict[str, str], name: str, value: str, rows: Mapping[str, Keyword], at: tuple[str, str]) -> None:
    """Adds a keyword to the fields, by its row in a table; `at` is in what it stands, and where."""
    if message_keywords.is_free(name):
        return
    within, where = at
    if name not in rows:
        raise ScenarioError(where, name, f"a keyword of the {within}")
    if rows[name].use is Use.REFUSED:
        raise ScenarioError(where, name, rows[name].why)
    if name in fields:
        raise ScenarioError(where, f"{name} once more", f"each keyword of the {within} once")
    fields[name] = value


def _from_xml(text: str, key: str) -> list[Segment]:
    """Segments of the one message of an XML file, which may define no entities of its own."""
    if len(text) > _LARGEST_XML_BYTES:
        raise ScenarioError(key, f"XML of {len(text)} characters", f"at most {_LARGEST_XML_BYTES}")
    if "<!" in re.sub(r"<!(?:--|\[CDATA\[)", "", text):
        raise ScenarioError(key, "XML with a document type, as of a web page", "the XML of one message")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ScenarioError(key, f"XML with {error}"[:100], "the XML of one message") from None
    for element in root.iter():
        if _tag(element) not in _CONTAINERS and len(element):
            raise ScenarioError(key, f"an element {_tag(element):.40}", "the XML of one OEM, OMM or OPM")
        if _tag(element) in _CONTAINERS:
            _check_container(element, key)
    messages = [element for element in root.iter() if _tag(element) in ("oem", "omm", "opm")]
    if len(messages) != 1:
        raise ScenarioError(key, f"{len(messages)} messages", "the XML of one OEM, OMM or OPM")
    kind = _kind(_tag(messages[0]).upper(), messages[0].get("version", VERSIONS[-1]), key)
    segments = [element for element in messages[0].iter() if _tag(element) == "segment"]
    if not segments or (kind != "OEM" and len(segments) > 1):
        raise ScenarioError(key, f"{len(segments)} segments", f"the XML of one {kind}")
    for outer, inner in ([root], messages), (list(messages[0]), segments):
        _fields({}, outer, message_keywords.HEADER, kind, key, apart=tuple(inner))
    return [_segment(element, kind, key) for element in segments]


def _check_container(element: ElementTree.Element, key: str) -> None:
    """Refuses text and attributes of an element that holds other elements: they have no meaning there."""
    texts = [element.text, *(each.tail for each in element)]
    loose = next((text.strip() for text in texts if text and text.strip()), None)
    if loose is not None:
        raise ScenarioError(key, f"{loose:.40} in {_tag(element)}, outside of an element", "elements alone")
    own = [name for name in element.attrib if name[:1] != "{" and _tag(element) not in ("ndm", "oem", "omm", "opm")]
    if own:
        raise ScenarioError(key, f"{_tag(element)} with {own[0]} = {element.get(own[0]):.30}", "no attribute there")


def _segment(element: ElementTree.Element, kind: MessageKind, key: str) -> Segment:
    segment = Segment(key, kind)
    if kind != "OEM":
        _fields(segment.fields, [element], KEYWORDS[kind], kind, key)
        return segment
    states = [each for each in element.iter() if _tag(each) == "stateVector"]
    covariances = [each for each in element.iter() if _tag(each) == "covarianceMatrix"]
    _fields(segment.fields, [element], message_keywords.OEM_METADATA, kind, key, apart=(*states, *covariances))
    for each in covariances:
        _fields({}, [each], message_keywords.OEM_COVARIANCE, kind, key)
    for number, each in enumerate(states, start=1):
        found: dict[str, str] = {}
        where = f"{key} state {number}"
        _fields(found, [each], message_keywords.OEM_STATE, kind, where)
        names = tuple(name for name in _STATE_NAMES if name in found)
        if names not in (_STATE_NAMES[:7], _STATE_NAMES):
            raise ScenarioError(where, ", ".join(names), ", ".join(_STATE_NAMES[:7]))
        segment.rows.append((where, [found[name] for name in names]))
    return segment


def _fields(
    fields: dict[str, str],
    within: list[ElementTree.Element],
    rows: Mapping[str, Keyword],
    kind: MessageKind,
    key: str,
    apart: tuple[ElementTree.Element, ...] = (),
) -> None:
    """Adds the keywords in elements to the fields, but not those in some elements apart."""
    for element in _leaves(within, set(apart)):
        name, unit, value = _tag(element), element.get("units"), (element.text or "").strip()
        row = rows.get(name)
        others = [] if message_keywords.is_free(name) else [each for each in element.attrib if each[:1] != "{"]
        if unknown := [each for each in others if each != "units"]:
            raise ScenarioError(
                key, f"{name} with {unknown[0]} = {element.get(unknown[0]):.30}", "units alone beside it"
            )
        if unit is not None and row is not None and row.unit is not None:
            value = f"{value} [{unit}]"
        _put(fields, name, value, rows, (kind, key))


def _leaves(within: list[ElementTree.Element], apart: set[ElementTree.Element]) -> Iterator[ElementTree.Element]:
    for element in within:
        if element in apart:
            continue
        if _tag(element) in _CONTAINERS:
            yield from _leaves(list(element), apart)
        else:
            yield element


def _tag(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else "COMMENT"
