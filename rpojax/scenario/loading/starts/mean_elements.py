"""States from mean elements by SGP4: two-line elements, and OMM."""

import math
import re
from decimal import Decimal
from typing import Any, Final

import numpy as np

from rpojax.errors import ScenarioError
from rpojax.optional_packages import require_package
from rpojax.scenario.loading.starts.inertial_frames import to_inertial
from rpojax.scenario.loading.starts.message_text import Segment
from rpojax.scenario.loading.starts.orbit_states import OrbitState
from rpojax.time_scales import PS, Instant, instant

_LINE_LENGTH: Final = 69
_SGP4_DAYS: Final = 18263.5
"""Days from 1949-12-31 00:00, from which SGP4 counts, to 2000-01-01 12:00."""
_ELEMENTS: Final = (
    *("MEAN_MOTION", "ECCENTRICITY", "INCLINATION", "RA_OF_ASC_NODE", "ARG_OF_PERICENTER", "MEAN_ANOMALY", "BSTAR"),
)
_RATES: Final = ("MEAN_MOTION_DOT", "MEAN_MOTION_DDOT")
_MU_WGS72: Final = 398600.8
"""Gravity of the Earth in SGP4 [km^3/s^2]."""
_RAD_PER_DEG: Final = math.pi / 180.0
_RAD_MIN_PER_REV_DAY: Final = 2.0 * math.pi / 1440.0
_FURTHEST_S: Final = 30.0 * 86400.0
"""Mean elements say nothing of times farther from their epoch than this."""
_LARGEST_INCLINATION_DEG: Final = 180.0 + 1e-9
_COLUMNS: Final = (
    re.compile(
        r"1 (?P<object>[ \dA-HJ-NP-Z][ \d]{3}\d)[ A-Z] .{8} (?P<year>[ \d]\d)(?P<day>[ \d]{2}\d\.\d{8}) "
        r"[ +\-0]\.\d{8} [ +-][ \d]{5}[ +-]\d [ +-][ \d]{5}[ +-]\d (?P<ephemeris_type>.) [ \d]{4}\d",
        re.ASCII,
    ),
    re.compile(
        r"2 (?P<object>[ \dA-HJ-NP-Z][ \d]{3}\d) [ \d]{2}\d\.\d{4} [ \d]{2}\d\.\d{4} [ \d]{7} [ \d]{2}\d\.\d{4} "
        r"[ \d]{2}\d\.\d{4} [ \d]\d\.\d{8}[ \d]{5}\d",
        re.ASCII,
    ),
)
"""Forms of both lines."""
_FIRST_CENTURY_YEAR: Final = 57
"""Two digits of a year from which on it is in the 20th century: Sputnik's."""


def is_two_line(text: str) -> bool:
    """Whether a text has lines of element sets."""
    return any(line[:2] in ("1 ", "2 ") for line in text.splitlines())


def from_two_lines(text: str, epoch: Instant | None, key: str) -> OrbitState:
    """State of the one object of a file of two-line elements, at their epoch or another one.

    Raises:
        ScenarioError: there are other lines than a name and those of one element set, or SGP4 refuses them.
    """
    lines = [line.rstrip() for line in text.splitlines() if line.strip()]
    # The name of an object may begin like an element line.
    named = lines[1:] if len(lines) == 3 and lines[1][:2] == "1 " else lines
    elements = [line for line in named if line[:2] in ("1 ", "2 ")]
    if [line[0] for line in elements] != ["1", "2"]:
        raise ScenarioError(key, f"{len(elements)} element lines", "line 1 and line 2 of one object")
    if lines[-2:] != elements or len(lines) > 3:
        raise ScenarioError(
            key, f"{len(lines)} lines", "line 1 and line 2 of one object, and a line before with its name"
        )
    first, second = (_columns(line, form, key) for line, form in zip(elements, _COLUMNS, strict=True))
    if first["object"] != second["object"]:
        raise ScenarioError(key, f"objects {first['object']} and {second['object']}", "lines of one object")
    if first["ephemeris_type"] not in "0 ":
        raise ScenarioError(key, f"ephemeris type {first['ephemeris_type']} (column 63)", "0, elements of SGP4")
    satellite = require_package("sgp4.api").Satrec.twoline2rv(*elements)
    name = lines[0].removeprefix("0 ").strip() if len(lines) == 3 else first["object"].strip()
    return _state(satellite, _epoch(first["year"], first["day"], key), epoch, key, ("TLE", name))


def _columns(line: str, form: re.Pattern[str], key: str) -> dict[str, str]:
    """Parts of an element line, which must have its form and checksum."""
    sums = str(sum(int(letter) if letter.isdecimal() else letter == "-" for letter in line[:-1]) % 10)
    found = form.fullmatch(line)
    if found is None or not line.isascii():
        raise ScenarioError(key, f"{line[:1]} ... {line[-1]}", f"an element line of {_LINE_LENGTH} with its columns")
    if line[-1] != sums:
        raise ScenarioError(key, f"{line[:1]} ... {line[-1]}", f"an element line of {_LINE_LENGTH} with its checksum")
    return found.groupdict()


def _epoch(year: str, day: str, key: str) -> Instant:
    """Instant of the two digits of a year and a day of it with a fraction."""
    whole, _, fraction = day.strip().partition(".")
    full = int(year) + (1900 if int(year) >= _FIRST_CENTURY_YEAR else 2000)
    try:
        midnight = instant(f"{full}-{int(whole):03d}T00:00:00")
    except ValueError as error:
        raise ScenarioError(key, f"epoch {year}{day}", str(error)) from None
    return Instant(midnight.tai_ps + round(Decimal(f"0.{fraction}") * 86400 * PS))


def from_message(segment: Segment, epoch: Instant | None, key: str) -> OrbitState:
    """State of an OMM, at its epoch or another one.

    Raises:
        ScenarioError: a keyword is missing or another theory is meant, or SGP4 refuses the elements.
    """
    for name, *expected in (
        ("MEAN_ELEMENT_THEORY", "SGP4", "SGP/SGP4"),
        ("REF_FRAME", "TEME"),
        ("TIME_SYSTEM", "UTC"),
        ("CENTER_NAME", "EARTH"),
    ):
        segment.check(name, *expected)
    if segment.fields.get("EPHEMERIS_TYPE"):
        segment.check("EPHEMERIS_TYPE", "0")
    if segment.fields.get("GM") and segment.number("GM") != _MU_WGS72:
        raise ScenarioError(key, f"GM = {segment.fields['GM']:.30}", f"{_MU_WGS72}, that of SGP4")
    begin = segment.time("EPOCH")
    number = {name: segment.number(name) for name in _ELEMENTS}
    rates = [segment.number(name) if segment.fields.get(name) else 0.0 for name in _RATES]
    api = require_package("sgp4.api")
    satellite = api.Satrec()
    satellite.sgp4init(
        api.WGS72,
        "i",
        0,
        begin.utc_days + _SGP4_DAYS,
        number["BSTAR"],
        rates[0] * _RAD_MIN_PER_REV_DAY / 1440.0,
        rates[1] * _RAD_MIN_PER_REV_DAY / 1440.0**2,
        number["ECCENTRICITY"],
        number["ARG_OF_PERICENTER"] * _RAD_PER_DEG,
        number["INCLINATION"] * _RAD_PER_DEG,
        number["MEAN_ANOMALY"] * _RAD_PER_DEG,
        number["MEAN_MOTION"] * _RAD_MIN_PER_REV_DAY,
        number["RA_OF_ASC_NODE"] * _RAD_PER_DEG,
    )
    return _state(satellite, begin, epoch, key, ("OMM", segment.fields.get("OBJECT_NAME", "UNKNOWN")))


def _state(satellite: Any, begin: Instant, epoch: Instant | None, key: str, label: tuple[str, str]) -> OrbitState:
    """State by SGP4 in N: at the epoch of the elements or at another one; `label` is format and object."""
    eccentricity, inclination_deg = satellite.ecco, math.degrees(satellite.inclo)
    if not (0.0 <= eccentricity < 1.0 and 0.0 <= inclination_deg <= _LARGEST_INCLINATION_DEG):
        found = f"eccentricity {eccentricity:g} and inclination {inclination_deg:g} deg"
        raise ScenarioError(key, found, "0 to below 1, and 0 to 180 deg")
    at = epoch or begin
    if abs(at - begin) > _FURTHEST_S:
        raise ScenarioError(key, f"elements of {begin.utc()[:10]}", f"elements within 30 days of {at.utc()[:10]}")
    code, position_km, velocity_km_s = satellite.sgp4_tsince((at - begin) / 60.0)
    if code or not np.all(np.isfinite(position_km)):
        raise ScenarioError(key, f"error {code} of SGP4", "elements of an orbit that it can propagate")
    R = to_inertial("TEME", at, key)
    return OrbitState(
        at, R @ (1e3 * np.array(position_km)), R @ (1e3 * np.array(velocity_km_s)), label[0], "TEME", label[1]
    )
