"""Orbit from altitude and local time or angle of the Sun, and starts at which the target is in the light."""

import math
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from rpojax.core.constants import J2_EARTH, MU_EARTH, RADIUS_EARTH
from rpojax.core.orbits import sun_moon_ephemeris
from rpojax.errors import RpojaxError
from rpojax.scenario.own_mission.choices import Choice, Choices, tidy
from rpojax.scenario.own_mission.facts import MissionFacts
from rpojax.value_types import epoch_seconds

_YEAR_S = 365.2422 * 86400.0
_DAWN_DUSK_H = 18.0
_AIR = (
    (200.0, 2.79e-10, 37.1),
    (300.0, 2.42e-11, 53.6),
    (400.0, 3.73e-12, 58.5),
    (500.0, 6.97e-13, 63.8),
    (600.0, 1.45e-13, 71.8),
    (700.0, 3.61e-14, 88.7),
    (800.0, 1.17e-14, 124.6),
    (1000.0, 3.02e-15, 268.0),
)
"""Altitude [km], density [kg/m^3] and scale height [km] (Vallado, Fundamentals of Astrodynamics, table 8-4)."""
_AFTER_SUNRISE_DEG, _WINDOW_DEG, _OF_LIGHT = 15.0, 60.0, 0.3


@dataclass(frozen=True)
class Orbit:
    """Circular orbit of a mission.

    Attributes:
        semi_major_axis_m: of it
        inclination_deg: of it
        raan_deg: of its ascending node
        period_s: of it
        choices: its keys
    """

    semi_major_axis_m: float
    inclination_deg: float
    raan_deg: float
    period_s: float
    choices: Choices


def orbit_of(facts: MissionFacts, epoch_utc: str) -> Orbit:
    """Orbit of a mission that starts at an epoch.

    Raises:
        RpojaxError: no inclination or node is as asked for.
    """
    axis = RADIUS_EARTH + 1e3 * facts.altitude_km
    inclination, why = _inclination(facts, axis)
    sun = np.asarray(sun_moon_ephemeris.sun_position(jnp.float64(epoch_seconds(epoch_utc))))
    ascension = math.degrees(math.atan2(sun[1], sun[0]))
    declination = math.degrees(math.asin(sun[2] / np.linalg.norm(sun)))
    if facts.beta_deg is None:
        hour = _DAWN_DUSK_H if facts.local_time_h is None else facts.local_time_h
        node, reason = ascension + 15.0 * (hour - 12.0), f"local time {hour:g} h, the Sun at {ascension:.3g} deg"
    else:
        node = ascension + _node_from_sun(facts.beta_deg, inclination, declination)
        reason = f"{facts.beta_deg:g} deg of the Sun out of the orbit plane, the Sun at {ascension:.3g} deg"
    node = tidy(node % 360.0, 5)
    choices = [
        Choice("orbit.semi_major_axis_m", tidy(axis, 8), f"{facts.altitude_km:g} km above the equator"),
        Choice("orbit.inclination_deg", inclination, why),
        Choice("orbit.raan_deg", node, reason),
        *_air(facts.altitude_km),
    ]
    return Orbit(axis, inclination, node, 2.0 * math.pi * math.sqrt(axis**3 / MU_EARTH), Choices(choices))


def _inclination(facts: MissionFacts, axis_m: float) -> tuple[float, str]:
    if facts.inclination_deg is not None:
        return facts.inclination_deg, ""
    rate = 2.0 * math.pi / _YEAR_S
    motion = math.sqrt(MU_EARTH / axis_m**3)
    cosine = -rate / (1.5 * J2_EARTH * motion * (RADIUS_EARTH / axis_m) ** 2)
    if cosine >= -1.0:
        return tidy(math.degrees(math.acos(cosine)), 5), f"Sun-synchronous at {facts.altitude_km:g} km"
    return 3.0, f"no orbit at {facts.altitude_km:g} km is Sun-synchronous; as one of the geostationary ring, unkept"


def _node_from_sun(beta_deg: float, inclination_deg: float, declination_deg: float) -> float:
    """Right ascension of the node less that of the Sun [deg]."""
    beta, i, d = map(math.radians, (beta_deg, inclination_deg, declination_deg))
    slope, offset = math.cos(d) * math.sin(i), math.sin(d) * math.cos(i)
    if abs(math.sin(beta) - offset) > slope:
        low, high = (math.degrees(math.asin(max(-1.0, min(1.0, offset + sign * slope)))) for sign in (-1.0, 1.0))
        expected = f"{low:.3g} to {high:.3g} at an inclination of {inclination_deg:g} deg and this date"
        raise RpojaxError.of_argument("beta_deg", f"found {beta_deg:g}, expected {expected}")
    return math.degrees(math.asin((math.sin(beta) - offset) / slope))


def _air(altitude_km: float) -> list[Choice]:
    known, density, height = max((each for each in _AIR if each[0] <= altitude_km), default=_AIR[0])
    reason = "moderate solar activity"
    return [
        Choice("atmosphere.density_kg_m3", density, reason, True),
        Choice("atmosphere.altitude_m", 1e3 * known, "", True),
        Choice("atmosphere.scale_height_m", 1e3 * height, "", True),
    ]


@dataclass(frozen=True)
class Starts:
    """Places on the orbit at which runs start.

    Attributes:
        choices: their dispersion
        light_deg: way on the orbit from the last of them into the dark
    """

    choices: Choices
    light_deg: float


def start_choices(blocked: np.ndarray) -> Starts:
    """Places on the orbit at which runs start, where the target cannot be seen from some or all.

    Args:
        blocked: (n,) at equal steps of true anomaly from 0 deg
    """
    share, step = float(blocked.mean()), 360.0 / len(blocked)
    if share == 1.0:
        return Starts(Choices(), 0.0)
    rise, light = (step * each for each in _longest_light(blocked))
    low = round(rise + min(_AFTER_SUNRISE_DEG, 0.1 * light))
    high = round(low + min(_WINDOW_DEG, _OF_LIGHT * light))
    entry = {"key": "orbit.true_anomaly_deg", "kind": "uniform", "low": float(low), "high": float(high)}
    reason = (
        f"the target cannot be seen in {100.0 * share:.0f} % of an orbit; the start is in the light, from "
        f"{rise:.0f} to {rise + light:.0f} deg"
    )
    return Starts(Choices([], [Choice("dispersions", entry, reason)]), rise + light - high)


def _longest_light(blocked: np.ndarray) -> tuple[int, int]:
    """Index at which the longest stretch without a block begins, and its length."""
    count = len(blocked)
    begins = [index for index in range(count) if not blocked[index] and blocked[index - 1]] or [0]
    lengths = []
    for begin in begins:
        ahead = np.roll(blocked, -begin)
        lengths.append(int(np.argmax(ahead)) if ahead.any() else count)
    best = int(np.argmax(lengths))
    return begins[best], lengths[best]
