"""States from an OEM: one of its lines, or interpolated between them with an estimate of the error."""

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import KroghInterpolator

from rpojax.core.constants import J2_EARTH, MU_EARTH, RADIUS_EARTH
from rpojax.errors import ScenarioError
from rpojax.scenario.loading.starts.inertial_frames import to_inertial
from rpojax.scenario.loading.starts.message_text import Segment, number_in
from rpojax.scenario.loading.starts.orbit_states import OrbitState, check_bound
from rpojax.time_scales import Instant

_NODES: Final = 6
"""Lines around an epoch through which a Hermite polynomial of degree 11 goes."""
_LARGEST_ERROR_M: Final = 1.0
"""Estimate of an interpolation's error beyond which it is refused."""
_LARGEST_UNMODELLED_M_S2: Final = 1e-4
"""More than the attraction beyond the Earth's flattening, the air, Sun and Moon accelerate a spacecraft by."""
_LARGEST_MISS: Final = 0.02
"""Share of the way to a neighbour; attraction and an even thrust are followed, and an impulse is on one side."""
_OFF_AT_BURN: Final = 0.25
"""Interpolation's largest error at a burn over the product of the burn and the spacing of rows."""
_LONGEST_FLIGHT_S: Final = 21600.0
"""Longest time between rows over which the attraction is integrated."""
_ROUNDED_S: Final = 1.0
"""Rounding of START_TIME and STOP_TIME that writers allow themselves."""
_UNITS: Final = 3 * ("km",) + 3 * ("km/s",)


@dataclass(frozen=True)
class _Ephemeris:
    """States of a segment.

    Attributes:
        segment: where they are from
        times: of each state
        states: (n, 6) position [m] and velocity [m/s] in the segment's frame
        begin: first instant at which they may be used
        end: last one
    """

    segment: Segment
    times: Sequence[Instant]
    states: np.ndarray
    begin: Instant
    end: Instant


def state_of(segments: Sequence[Segment], epoch: Instant | None, key: str) -> OrbitState:
    """State of an OEM at an epoch, by default that of its first line that may be used.

    Where two segments meet, as at a burn, the state is that of the later one, from which the run goes on.

    Raises:
        ScenarioError: it is of several objects or not about the Earth, it has no state at the epoch, or its states are
            too far apart.
    """
    if not segments:
        raise ScenarioError(key, "no states", "an OEM with META_START and lines of states")
    objects = {(each.fields.get("OBJECT_NAME", ""), each.fields.get("OBJECT_ID", "")) for each in segments}
    if len(objects) != 1:
        found = ", ".join(sorted(f"{name} ({identity})" for name, identity in objects))
        raise ScenarioError(key, f"{len(objects)} objects: {found:.80}", "an OEM of one object")
    parts = sorted((_ephemeris(segment, key) for segment in segments), key=lambda each: (each.begin, each.end))
    at = epoch or next((time for time in parts[0].times if time >= parts[0].begin), parts[0].begin)
    containing = [each for each in parts if each.begin <= at <= each.end]
    if not containing:
        raise _nothing_at(parts, at, key)
    *others, last = containing
    if others and not (last.begin == at and all(each.end == at for each in others)):
        found = f"{len(containing)} segments with states at {at.utc()}"
        raise ScenarioError(key, found, "one, or one that ends and one that begins there")
    return _state(last, at, key)


def _nothing_at(parts: Sequence[_Ephemeris], at: Instant, key: str) -> ScenarioError:
    for earlier, later in pairwise(parts):
        if earlier.end < at < later.begin:
            gap = f"no states between {earlier.end.utc()} and {later.begin.utc()}"
            return ScenarioError(key, gap, f"some about {at.utc()}")
    found = f"states from {parts[0].begin.utc()} to {parts[-1].end.utc()}"
    return ScenarioError(key, found, f"some about {at.utc()}")


def _ephemeris(segment: Segment, key: str) -> _Ephemeris:
    segment.check("CENTER_NAME", "EARTH")
    if not segment.rows:
        raise ScenarioError(key, "no states", "an OEM with META_START and lines of states")
    rows = [_row(words, segment, where) for where, words in segment.rows]
    times, states = [time for time, _ in rows], 1e3 * np.array([values for _, values in rows])
    for (first, second), (where, _) in zip(pairwise(times), segment.rows[1:], strict=True):
        if second <= first:
            raise ScenarioError(where, f"{second.utc()} after {first.utc()}", "increasing times in a segment")
    limits = {
        name: segment.time(name) if segment.fields.get(name) else None
        for name in ("START_TIME", "STOP_TIME", "USEABLE_START_TIME", "USEABLE_STOP_TIME")
    }
    start, stop = limits["START_TIME"] or times[0], limits["STOP_TIME"] or times[-1]
    if start - times[0] > _ROUNDED_S or times[-1] - stop > _ROUNDED_S:
        found = f"states from {times[0].utc()} to {times[-1].utc()}"
        raise ScenarioError(key, found, f"START_TIME to STOP_TIME, {start.utc()} to {stop.utc()}")
    begin = max(times[0], limits["USEABLE_START_TIME"] or times[0])
    end = min(times[-1], limits["USEABLE_STOP_TIME"] or times[-1])
    if begin > end:
        found = f"states from {times[0].utc()} to {times[-1].utc()}"
        raise ScenarioError(key, found, "some between USEABLE_START_TIME and USEABLE_STOP_TIME")
    return _Ephemeris(segment, times, states, begin, end)


def _row(words: list[str], segment: Segment, where: str) -> tuple[Instant, list[float]]:
    time, *cells = words
    values = [number_in(cell, unit) for cell, unit in zip(cells, _UNITS, strict=False)]
    if len(cells) not in (6, 9) or None in values or any(number_in(cell, "km/s**2") is None for cell in cells[6:]):
        raise ScenarioError(where, " ".join(words)[:60], "a time and six numbers [km, km/s]")
    return segment.instant(time, where), [value for value in values if value is not None]


def _state(part: _Ephemeris, epoch: Instant, key: str) -> OrbitState:
    used = _nodes(part, epoch)
    for (where, _), state in zip(part.segment.rows[used], part.states[used], strict=True):
        check_bound(state[:3], state[3:], where)
    nearest = min(range(len(part.times)), key=lambda number: abs(part.times[number].tai_ps - epoch.tai_ps))
    if part.times[nearest] == epoch:
        _check_velocity(part, nearest)
        state, error = part.states[nearest], None
    else:
        state, error = _interpolated(part, epoch)
        if not error <= _LARGEST_ERROR_M:
            found = f"states too far apart about {epoch.utc()}: interpolated with an error of {error:.3g} m"
            raise ScenarioError(key, found, f"states with which it is at most {_LARGEST_ERROR_M:g} m")
        _check_without_burn(part, epoch, key)
    fields = part.segment.fields
    frame, fixed = part.segment.needed("REF_FRAME"), bool(fields.get("REF_FRAME_EPOCH"))
    R = to_inertial(frame, part.segment.time("REF_FRAME_EPOCH") if fixed else epoch, key)
    name = fields.get("OBJECT_NAME", "UNKNOWN")
    return OrbitState(epoch, R @ state[:3], R @ state[3:], "OEM", frame, name, error)


def _check_velocity(part: _Ephemeris, row: int) -> None:
    """Refuses a state whose velocity leads to neither neighbour, as one of axes that turn with the Earth."""
    state, where = part.states[row], part.segment.rows[row][0]
    missed = []
    for other in (row - 1, row + 1):
        if 0 <= other < len(part.times) and abs(span := part.times[other] - part.times[row]) <= _LONGEST_FLIGHT_S:
            way = _LARGEST_MISS * abs(span) * float(np.linalg.norm(state[3:]))
            there, flown = part.states[other], _flown(state, span, 0.0)
            miss = flown[:3] - there[:3]
            pushed = miss + 0.5 * span * (there[3:] - flown[3:])  # by an even thrust beside gravity
            off = min(float(np.linalg.norm(each)) for each in (miss, pushed))
            missed.append((off > max(way, _LARGEST_ERROR_M), off))
    if missed and all(is_off for is_off, _ in missed):
        found = f"a velocity that misses the next state by {min(off for _, off in missed):.3g} m"
        raise ScenarioError(where, found, "that of the positions, in the frame of the message")


def _check_without_burn(part: _Ephemeris, epoch: Instant, key: str) -> None:
    """Refuses to interpolate over a burn, which no polynomial follows, and whose error no estimate sees.

    What else accelerates a spacecraft changes little from one row to the next: a burn is what neighbouring pairs of
    rows do not have. Without such a pair it is what exceeds all other accelerations.
    """
    rows = _nodes(part, epoch)
    around = slice(max(0, rows.start - 1), rows.stop + 1)
    pairs = list(pairwise(zip(part.times[around], part.states[around], strict=True)))
    pushes: dict[int, np.ndarray] = {}  # mean accelerations beside gravity [m/s^2]
    for number, ((begin, first), (end, second)) in enumerate(pairs):
        if (span := end - begin) <= _LONGEST_FLIGHT_S:
            missed = [(second[3:] - _flown(first, span, j2)[3:]) / span for j2 in (0.0, J2_EARTH)]
            pushes[number] = min(missed, key=_length)
    first_inside = rows.start - around.start
    inside = range(first_inside, first_inside + len(part.times[rows]) - 1)
    for number in sorted(pushes.keys() & inside, key=lambda each: -_length(pushes[each])):
        (begin, _), (end, _) = pairs[number]
        beside = [pushes[other] for other in (number - 1, number + 1) if other in pushes]
        usual = [*beside, np.mean(beside, axis=0)] if beside else [np.zeros(3)]
        push, span = min(_length(pushes[number] - each) for each in usual), end - begin
        if (beside or push > _LARGEST_UNMODELLED_M_S2) and push * span**2 * _OFF_AT_BURN > _LARGEST_ERROR_M:
            change = f"{_length(pushes[number]) * span:.3g} m/s"
            found = f"a change of {change} beside gravity from {begin.utc()} to {end.utc()}"
            raise ScenarioError(key, found, "rows without a burn to interpolate, or segments that meet at it")


def _length(vector: np.ndarray) -> float:
    return float(np.linalg.norm(vector))


def _flown(state: np.ndarray, span_s: float, j2: float) -> np.ndarray:
    """State (6,) some time after another one, by the Earth's attraction; the axis of each known frame is its own."""

    def rates(_: float, values: np.ndarray) -> np.ndarray:
        r, distance = values[:3], float(np.linalg.norm(values[:3]))
        flattening = 1.5 * j2 * (RADIUS_EARTH / distance) ** 2
        factors = 1.0 + flattening * (np.array([1.0, 1.0, 3.0]) - 5.0 * (r[2] / distance) ** 2)
        return np.concatenate([values[3:], -MU_EARTH / distance**3 * factors * r])

    found = solve_ivp(rates, (0.0, span_s), state, method="DOP853", rtol=1e-10, atol=1e-5)
    return np.asarray(found.y[:, -1])


def _nodes(part: _Ephemeris, epoch: Instant) -> slice:
    """Lines through which the polynomial about an epoch goes."""
    first = min(max(0, bisect_left(part.times, epoch) - _NODES // 2), max(0, len(part.times) - _NODES))
    return slice(first, first + _NODES)


def _interpolated(part: _Ephemeris, epoch: Instant) -> tuple[np.ndarray, float]:
    """State (6,) at an epoch between the lines of a segment, and an estimate of its position's error [m].

    The estimate is the difference to the polynomial without the node farthest from the epoch; of two nodes, the
    remainder of the cubic polynomial with the fourth derivative of two-body motion.
    """
    rows = _nodes(part, epoch)
    times, states = np.array([time - epoch for time in part.times[rows]]), part.states[rows]
    state = _hermite(times, states)
    if len(times) > 2:
        kept = np.arange(len(times)) != np.argmax(np.abs(times))
        return state, float(np.linalg.norm(state[:3] - _hermite(times[kept], states[kept])[:3]))
    return state, _fourth_derivative(state) / math.factorial(4) * float(times[0] * times[1]) ** 2


def _hermite(times: np.ndarray, states: np.ndarray) -> np.ndarray:
    """State (6,) at time zero of the polynomial through positions and velocities (n, 6) at some times."""
    polynomial = KroghInterpolator(np.repeat(times, 2), states.reshape(-1, 3))
    return np.concatenate([polynomial(0.0), polynomial.derivative(0.0)])


def _fourth_derivative(state: np.ndarray) -> float:
    """Magnitude of the fourth derivative [m/s^4] of the position in two-body motion, r'' = f r with f = -mu / |r|^3."""
    r, v = state[:3], state[3:]
    distance, along = float(np.linalg.norm(r)), float(r @ v)
    f = -MU_EARTH / distance**3
    f_1 = 3.0 * MU_EARTH * along / distance**5
    f_2 = 3.0 * MU_EARTH * ((float(v @ v) + f * distance**2) / distance**5 - 5.0 * along**2 / distance**7)
    return float(np.linalg.norm((f_2 + f * f) * r + 2.0 * f_1 * v))
