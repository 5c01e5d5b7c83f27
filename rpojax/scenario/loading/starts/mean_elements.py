"""States from mean elements by SGP4: two-line elements, and OMM in key-value notation or XML."""

import math
from collections.abc import Mapping
from datetime import datetime, timedelta
from typing import Any, Final

import numpy as np

from rpojax.errors import ScenarioError
from rpojax.optional_packages import require_package
from rpojax.scenario.loading.starts.inertial_frames import to_inertial
from rpojax.scenario.loading.starts.orbit_states import OrbitState

_LINE_LENGTH: Final = 69
_SGP4_EPOCH: Final = datetime(1949, 12, 31)
_REQUIRED: Final = (
    *("EPOCH", "MEAN_MOTION", "ECCENTRICITY", "INCLINATION", "RA_OF_ASC_NODE", "ARG_OF_PERICENTER"),
    *("MEAN_ANOMALY", "BSTAR"),
)
_RAD_PER_DEG: Final = math.pi / 180.0
_RAD_MIN_PER_REV_DAY: Final = 2.0 * math.pi / 1440.0
_FURTHEST: Final = timedelta(days=30)
"""Mean elements say nothing of times farther from their epoch than this."""


def is_two_line(text: str) -> bool:
    """Whether a text has the two lines of an element set."""
    return len(_element_lines(text)) >= 2


def _element_lines(text: str) -> list[str]:
    lines = [line.rstrip() for line in text.splitlines() if line.strip()]
    return [line for line in lines if line[:2] in ("1 ", "2 ")]


def from_two_lines(text: str, epoch: datetime | None, key: str) -> OrbitState:
    """State of the one object of a file of two-line elements, at their epoch or another one.

    Raises:
        ScenarioError: there are other lines than those of one element set, or SGP4 refuses them.
    """
    lines = _element_lines(text)
    if len(lines) != 2 or [line[0] for line in lines] != ["1", "2"]:
        raise ScenarioError(key, f"{len(lines)} element lines", "line 1 and line 2 of one object")
    for line in lines:
        found = line[-1] if len(line) == _LINE_LENGTH else f"{len(line)} characters"
        if found != str(_checksum(line)):
            raise ScenarioError(key, f"{line[:1]} ... {found}", f"an element line of {_LINE_LENGTH} with its checksum")
    if lines[0][2:7] != lines[1][2:7]:
        raise ScenarioError(key, f"objects {lines[0][2:7]} and {lines[1][2:7]}", "lines of one object")
    api = require_package("sgp4.api")
    try:
        satellite = api.Satrec.twoline2rv(*lines)
    except ValueError as error:
        raise ScenarioError(key, str(error)[:80], "two-line elements") from None
    first = text.strip().splitlines()[0].strip()
    name = first.removeprefix("0 ").strip() if first[:2] != "1 " else lines[0][2:7].strip()
    begin: datetime = require_package("sgp4.conveniences").sat_epoch_datetime(satellite).replace(tzinfo=None)
    return _state(satellite, begin, epoch, key, ("TLE", name))


def _checksum(line: str) -> int:
    return sum(int(letter) if letter.isdecimal() else letter == "-" for letter in line[:-1]) % 10


def from_fields(fields: Mapping[str, str], epoch: datetime | None, key: str) -> OrbitState:
    """State of an OMM from its keywords, at its epoch or another one.

    Raises:
        ScenarioError: a keyword is missing or another theory is meant, or SGP4 refuses the elements.
    """
    for name, expected in (("MEAN_ELEMENT_THEORY", ("SGP4", "SGP/SGP4")), ("REF_FRAME", ("TEME",))):
        if fields.get(name, expected[0]).upper() not in expected:
            raise ScenarioError(key, f"{name} = {fields[name]:.30}", " or ".join(expected))
    if fields.get("TIME_SYSTEM", "UTC").upper() != "UTC" or fields.get("CENTER_NAME", "EARTH").upper() != "EARTH":
        raise ScenarioError(key, "another time system or center", "TIME_SYSTEM = UTC and CENTER_NAME = EARTH")
    missing = [name for name in _REQUIRED if name not in fields]
    if missing:
        raise ScenarioError(key, f"no {missing[0]}", "an OMM with the elements of SGP4")
    try:
        begin = datetime.fromisoformat(fields["EPOCH"].removesuffix("Z"))
        number = {name: float(fields[name]) for name in _REQUIRED[1:]}
        rates = [float(fields.get(name, "0")) for name in ("MEAN_MOTION_DOT", "MEAN_MOTION_DDOT")]
    except ValueError as error:
        raise ScenarioError(key, str(error)[:80], "numbers and a date in an OMM") from None
    if not all(map(math.isfinite, (*number.values(), *rates))):
        raise ScenarioError(key, "a number that is not finite", "finite elements in an OMM")
    api = require_package("sgp4.api")
    satellite = api.Satrec()
    satellite.sgp4init(
        api.WGS72,
        "i",
        0,
        (begin - _SGP4_EPOCH) / timedelta(days=1),
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
    return _state(satellite, begin, epoch, key, ("OMM", fields.get("OBJECT_NAME", "UNKNOWN")))


def _state(satellite: Any, begin: datetime, epoch: datetime | None, key: str, label: tuple[str, str]) -> OrbitState:
    """State by SGP4 in N: at the epoch of the elements or at another one; `label` is format and object."""
    at = epoch or begin
    if abs(at - begin) > _FURTHEST:
        raise ScenarioError(key, f"elements of {begin.date()}", f"elements within 30 days of {at.date()}")
    code, position_km, velocity_km_s = satellite.sgp4_tsince((at - begin) / timedelta(minutes=1))
    if code or not np.all(np.isfinite(position_km)):
        raise ScenarioError(key, f"error {code} of SGP4", "elements of an orbit that it can propagate")
    R = to_inertial("TEME", at, key)
    return OrbitState(
        at, R @ (1e3 * np.array(position_km)), R @ (1e3 * np.array(velocity_km_s)), label[0], "TEME", label[1]
    )
