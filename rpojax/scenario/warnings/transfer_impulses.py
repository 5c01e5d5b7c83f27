"""Impulses of transfers before flight, and times between impulses that no free motion or few of them fill.

As `core.orbits.two_impulse_transfer` and `flight.guidance.references.transfer`, whose import takes JAX.
"""

import itertools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from rpojax.scenario.phases.reference_sections import TransferSection
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.orbit_geometry import latitudes_after, mean_motion, motions_between

_REGULAR: Final = 0.4
"""Least singular value of a regular time [-]."""
_LONGEST_SHARE: Final = 0.9
_POINTS: Final = 361
"""Points of the way of a transfer at which it is looked at [-]."""
_NEARLY_CIRCULAR: Final = 0.01
"""Eccentricity up to which every place on the orbit is like any other [-]."""
_PLACES: Final = 24
"""Places on an elliptic orbit at which a phase may begin, at equal intervals of time [-]."""
_DURATION_STEP: Final = 0.005
"""Step of the search for regular durations, in periods [-]."""


@dataclass(frozen=True)
class TransferImpulses:
    """Transfer as it is flown from rest to rest.

    Attributes:
        way: (n, 3) positions along it [m]
        points: (k, 3) positions of its impulses [m]
        impulses: (k, 3) velocity changes [m/s]
    """

    way: np.ndarray
    points: np.ndarray
    impulses: np.ndarray


def transfer_impulses(file: ScenarioFile, transfer: TransferSection, start: np.ndarray) -> TransferImpulses:
    """Transfer from a `start` [m]; on an elliptic orbit that whose largest impulse is the median over places on it."""
    flown = [_flown_from(file, transfer, start, place) for place in _places(file)]
    by_size = sorted(flown, key=lambda each: float(np.max(np.linalg.norm(each.impulses, axis=1))))
    return by_size[len(by_size) // 2]


def share_of_singular_places(file: ScenarioFile, seconds: float) -> float:
    """Share of the orbit, by time, from which one impulse hardly moves the servicer along some direction in a time."""
    return float(np.mean([min(_singular_values(file, place, seconds)) < _REGULAR for place in _places(file)]))


def sensitivity(file: ScenarioFile, seconds: float) -> float:
    """Change of two impulses [m/s] for each metre of the position: the median over places on the orbit."""
    scaled = [
        math.hypot(1.0, latitudes_after(file, place, np.array([seconds]))[0] - place)
        / (seconds * max(min(_singular_values(file, place, seconds)), 1e-9))
        for place in _places(file)
    ]
    return float(np.median(scaled))


def nearest_regular(file: ScenarioFile, seconds: float) -> tuple[float | None, float | None]:
    """The nearest shorter and longer time [s] that is regular at most places; None where none is within an orbit."""
    step = _DURATION_STEP * 2.0 * math.pi / mean_motion(file)
    steps = range(1, round(1.0 / _DURATION_STEP) + 1)
    found = [
        next((time for time in times if time > 0.0 and share_of_singular_places(file, time) <= 0.5), None)
        for times in ((seconds + sign * count * step for count in steps) for sign in (-1.0, 1.0))
    ]
    return found[0], found[1]


def _places(file: ScenarioFile) -> list[float]:
    """Arguments of latitude [rad] at which a phase may begin, as far as they differ."""
    start = math.radians(file.orbit.argument_of_perigee_deg + file.orbit.true_anomaly_deg)
    if file.orbit.eccentricity <= _NEARLY_CIRCULAR:
        return [start]
    times = 2.0 * math.pi / mean_motion(file) * np.arange(_PLACES) / _PLACES
    return [float(each) for each in latitudes_after(file, start, times)]


def _singular_values(file: ScenarioFile, place: float, seconds: float) -> tuple[float, float]:
    """Effect of an impulse on the position after a time, least direction in the plane, and across it [-]."""
    motion = motions_between(file, place, np.array([seconds]))[0]
    return _effects(motion, _scale(file, place, seconds))


def _scale(file: ScenarioFile, place: float, seconds: float) -> float:
    angle = float(latitudes_after(file, place, np.array([seconds]))[0]) - place
    return math.hypot(1.0, angle) / seconds


def _effects(motion: np.ndarray, scale: float) -> tuple[float, float]:
    in_plane = motion[:2, 3:5] * scale
    return abs(float(np.linalg.det(in_plane))) / float(np.linalg.norm(in_plane)), abs(float(motion[2, 5])) * scale


def _damping(value: float) -> float:
    share = min((value / _REGULAR) ** 2, 1.0)
    return _REGULAR**2 * (1.0 - share * share * (3.0 - 2.0 * share))


def _flown_from(file: ScenarioFile, transfer: TransferSection, start: np.ndarray, place: float) -> TransferImpulses:
    """Transfer that begins at rest at an argument of latitude [rad]."""
    arcs = transfer.pulses - 1
    shares = np.arange(transfer.pulses) / arcs
    rate = math.log(transfer.speed_ratio)
    covered = np.expm1(rate * shares) / math.expm1(rate) if abs(rate) > 1e-6 else shares
    points = start + covered[:, None] * (np.array(transfer.position_m) - start)
    interval = transfer.duration_s / arcs
    places = latitudes_after(file, place, interval * np.arange(arcs))
    ways, at, impulses = [], [], []
    arrival = np.zeros(3)
    for number, (begin, end) in enumerate(itertools.pairwise(points)):
        before = np.zeros(3) if number == 0 else (end - begin) / interval
        departure, middle, delta_v, states = _arc(file, float(places[number]), begin, before, end, interval, arcs)
        ways.append(states[:, :3])
        at += [begin, middle] if np.any(delta_v) else [begin]
        impulses += [departure - arrival, delta_v] if np.any(delta_v) else [departure - arrival]
        arrival = states[-1, 3:]
    return TransferImpulses(np.concatenate(ways), np.array([*at, points[-1]]), np.array([*impulses, -arrival]))


def _arc(
    file: ScenarioFile, place: float, begin: np.ndarray, before: np.ndarray, end: np.ndarray, seconds: float, arcs: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Velocity at departure, position and size of the impulse on the way, zero at regular times, and states."""
    times = seconds * np.linspace(0.0, 1.0, max(2, _POINTS // arcs))
    motion = motions_between(file, place, times)
    scale = _scale(file, place, seconds)
    missing = end - motion[-1, :3] @ np.concatenate([begin, before])
    matrix = motion[-1, :3, 3:] * scale
    least, across = _effects(motion[-1], scale)
    damping = np.diag([_damping(least)] * 2 + [_damping(across)])
    departure = before + matrix.T @ np.linalg.solve(matrix @ matrix.T + damping, missing) * scale
    states = motion @ np.concatenate([begin, departure])
    if not damping.any():
        return departure, begin, np.zeros(3), states
    last = min(_time_of_last_quarter(file, place, seconds), _LONGEST_SHARE * seconds)
    middle = float(latitudes_after(file, place, np.array([seconds - last]))[0])
    delta_v = np.linalg.solve(motions_between(file, middle, np.array([last]))[0, :3, 3:], end - states[-1, :3])
    after = times - (seconds - last)
    added = motions_between(file, middle, np.maximum(after, 0.0))[:, :, 3:] @ delta_v
    there = motions_between(file, place, np.array([seconds - last]))[0, :3] @ np.concatenate([begin, departure])
    return departure, there, delta_v, states + np.where(after[:, None] >= 0.0, added, 0.0)


def _time_of_last_quarter(file: ScenarioFile, place: float, seconds: float) -> float:
    """Time [s] of the last quarter turn before the end of a time, by bisection."""
    wanted = float(latitudes_after(file, place, np.array([seconds]))[0]) - 0.5 * math.pi
    low, high = 0.0, seconds
    for _ in range(60):
        middle = 0.5 * (low + high)
        early = float(latitudes_after(file, place, np.array([middle]))[0]) < wanted
        low, high = (middle, high) if early else (low, middle)
    return seconds - low
