"""States from an OEM in key-value notation: one of its lines, or interpolated between them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import pairwise
from typing import Final

import numpy as np

from rpojax.errors import ScenarioError
from rpojax.scenario.loading.starts.inertial_frames import to_inertial
from rpojax.scenario.loading.starts.orbit_states import OrbitState

_NODES: Final = 4
"""Lines around an epoch through which a Hermite polynomial of degree 7 goes."""
_UTC_OF: Final = {"UTC": timedelta(), "TAI": timedelta(seconds=-37), "TT": timedelta(seconds=-69.184)}
"""UTC less another time scale, valid since 2017."""


@dataclass(frozen=True)
class _Segment:
    meta: Mapping[str, str]
    rows: Sequence[tuple[datetime, list[float]]]


def state_of(text: str, epoch: datetime | None, key: str) -> OrbitState:
    """State of an OEM at an epoch in UTC, by default that of its first line.

    Raises:
        ScenarioError: the text is no OEM about the Earth, or has no state at the epoch.
    """
    segments = _segments(text, key)
    names = {segment.meta.get("OBJECT_NAME", "") for segment in segments}
    if len(names) != 1:
        raise ScenarioError(key, f"{len(names)} objects", "an OEM of one object")
    chosen = epoch or segments[0].rows[0][0]
    for segment in segments:
        if segment.rows[0][0] <= chosen <= segment.rows[-1][0]:
            return _interpolated(segment, chosen, key)
    begin, end = segments[0].rows[0][0], segments[-1].rows[-1][0]
    raise ScenarioError(
        key, f"states from {begin.isoformat()} to {end.isoformat()}", f"some about {chosen.isoformat()}"
    )


def _segments(text: str, key: str) -> list[_Segment]:
    segments: list[_Segment] = []
    meta: dict[str, str] = {}
    rows: list[tuple[datetime, list[float]]] = []
    inside = covariance = False
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.strip()
        if not words or words.startswith("COMMENT"):
            continue
        if words in ("META_START", "COVARIANCE_START"):
            inside, covariance = words == "META_START", words == "COVARIANCE_START"
            if inside:
                meta, rows = {}, []
        elif words == "META_STOP":
            inside = False
            segments.append(_Segment(meta, rows))
        elif words == "COVARIANCE_STOP":
            covariance = False
        elif inside and "=" in words:
            name, _, value = words.partition("=")
            meta[name.strip()] = value.strip()
        elif segments and not covariance and not inside:
            rows.append(_row(words, meta, f"{key} line {number}"))
    if not segments or not all(segment.rows for segment in segments):
        raise ScenarioError(key, "no states", "an OEM with META_START and lines of states")
    for segment in segments:
        _check(segment, key)
    return segments


def _check(segment: _Segment, key: str) -> None:
    if (center := segment.meta.get("CENTER_NAME", "").upper()) != "EARTH":
        raise ScenarioError(key, f"CENTER_NAME = {center:.30}", "EARTH")
    times = [time for time, _ in segment.rows]
    if any(second <= first for first, second in pairwise(times)):
        raise ScenarioError(key, "states that are not in order of time", "increasing times")


def _row(words: str, meta: Mapping[str, str], where: str) -> tuple[datetime, list[float]]:
    scale = meta.get("TIME_SYSTEM", "").upper()
    if scale not in _UTC_OF:
        raise ScenarioError(where, f"TIME_SYSTEM = {scale:.30}", f"one of {', '.join(_UTC_OF)}")
    time, *cells = words.split()
    try:
        values = [float(cell) for cell in cells[:6]]
        moment = datetime.fromisoformat(time.removesuffix("Z")) if "T" in time else None
    except ValueError:
        moment, values = None, []
    if moment is None or moment.tzinfo is not None or len(cells) not in (6, 9) or not all(map(math.isfinite, values)):
        raise ScenarioError(where, words[:60], "a time and six numbers [km, km/s]")
    return moment + _UTC_OF[scale], values


def _interpolated(segment: _Segment, epoch: datetime, key: str) -> OrbitState:
    times = np.array([(time - epoch).total_seconds() for time, _ in segment.rows])
    values = 1e3 * np.array([row for _, row in segment.rows])
    nearest = int(np.argmin(np.abs(times)))
    if times[nearest] == 0.0:
        position, velocity = values[nearest, :3], values[nearest, 3:]
    else:
        from scipy.interpolate import KroghInterpolator

        first = min(max(0, int(np.searchsorted(times, 0.0)) - _NODES // 2), max(0, len(times) - _NODES))
        rows = slice(first, first + _NODES)
        nodes = np.repeat(times[rows], 2)
        known = np.stack([values[rows, :3], values[rows, 3:]], axis=1).reshape(-1, 3)
        polynomial = KroghInterpolator(nodes, known)
        position, velocity = np.asarray(polynomial(0.0)), np.asarray(polynomial.derivative(0.0))
    frame = segment.meta.get("REF_FRAME", "")
    R = to_inertial(frame, epoch, key)
    return OrbitState(epoch, R @ position, R @ velocity, "OEM", frame, segment.meta.get("OBJECT_NAME", "UNKNOWN"))
