"""Positions of Sun and Moon by analytic series in the mean equator and equinox of J2000.

The Sun is accurate to 0.01 deg and 1e-4 of its distance, the Moon to 0.1 deg and 1e-3 (Montenbruck and Gill,
Satellite Orbits, section 3.3.2, with four more terms of the Moon's distance from Meeus, Astronomical Algorithms, table
47.A).
"""

import math
from collections.abc import Callable
from typing import Any, Final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]

_CENTURY = 36525.0 * 86400.0
_OBLIQUITY = 0.40909280
_ARCSECOND = 4.84813681109536e-6

# Angles at 2000-01-01 12:00 terrestrial time [deg] and their rates [deg per century]: of the Sun the mean anomaly and
# the longitude of the perigee, of the Moon the mean longitude and the Delaunay arguments.
_SUN_ANGLES = ((357.5256, 35999.049), (282.9400, 0.3225))
_MOON_ANGLES = (
    (218.31617, 481267.88088 - 1.3972),
    (134.96292, 477198.86753),
    (357.52543, 35999.04944),
    (93.27283, 483202.01873),
    (297.85027, 445267.11135),
)

# Rows of the Moon's series: coefficient of the sine [arcsec] or, for the distance, of the cosine [km]; multiples of the
# Delaunay arguments l, l', F, D.
_MOON_LONGITUDE = (
    (22640, 1, 0, 0, 0),
    (769, 2, 0, 0, 0),
    (-4586, 1, 0, 0, -2),
    (2370, 0, 0, 0, 2),
    (-668, 0, 1, 0, 0),
    (-412, 0, 0, 2, 0),
    (-212, 2, 0, 0, -2),
    (-206, 1, 1, 0, -2),
    (192, 1, 0, 0, 2),
    (-165, 0, 1, 0, -2),
    (148, 1, -1, 0, 0),
    (-125, 0, 0, 0, 1),
    (-110, 1, 1, 0, 0),
    (-55, 0, 0, 2, -2),
)
_MOON_LATITUDE = (
    (-526, 0, 0, 1, -2),
    (44, 1, 0, 1, -2),
    (-31, -1, 0, 1, -2),
    (-25, -2, 0, 1, 0),
    (-23, 0, 1, 1, -2),
    (21, -1, 0, 1, 0),
    (11, 0, -1, 1, -2),
)
_MOON_DISTANCE = (
    (-20905, 1, 0, 0, 0),
    (-3699, -1, 0, 0, 2),
    (-2956, 0, 0, 0, 2),
    (-570, 2, 0, 0, 0),
    (246, 2, 0, 0, -2),
    (-205, 0, 1, 0, -2),
    (-171, 1, 0, 0, 2),
    (-152, 1, 1, 0, -2),
    (-130, 1, -1, 0, 0),
    (109, 0, 0, 0, 1),
    (105, 1, 1, 0, 0),
    (80, 1, 0, -2, 0),
)


@pytree
class Epoch:
    """Beginning of a run: a number of the run, not of the program.

    Whole turns before it are removed from angles in double precision, so that single precision suffices for the rest.

    Attributes:
        seconds: () terrestrial time since 2000-01-01 12:00 [s]
        sun_angles: (2,) mean anomaly of the Sun and longitude of its perigee [rad]
        moon_angles: (5,) mean longitude of the Moon and the Delaunay arguments l, l', F, D [rad]
    """

    seconds: Array
    sun_angles: Array
    moon_angles: Array


def epoch_at(seconds: float) -> Epoch:
    """Epoch at a terrestrial time since 2000-01-01 12:00 [s]."""

    def angles(rows: tuple[tuple[float, float], ...]) -> Any:
        return np.array([math.radians(math.fmod(start + rate * (seconds / _CENTURY), 360.0)) for start, rate in rows])

    numbers: dict[str, Any] = {"seconds": np.array(seconds)}
    return Epoch(**numbers, sun_angles=angles(_SUN_ANGLES), moon_angles=angles(_MOON_ANGLES))


J2000: Final = epoch_at(0.0)


@pytree
class SunMoonPositions:
    """Positions of the Sun and the Moon from the Earth's centre.

    Attributes:
        sun_N: (3,) [m]
        moon_N: (3,) [m]
    """

    sun_N: Array
    moon_N: Array


def sun_and_moon_at(epoch: Epoch, time: Scalar) -> SunMoonPositions:
    """Positions of Sun and Moon at `time` [s] since the start; equal for all runs of a batch."""
    return SunMoonPositions(sun_N=sun_position(time, epoch), moon_N=moon_position(time, epoch))


def sun_position(seconds: Scalar, epoch: Epoch = J2000) -> Vector:
    """Position [m] of the Sun from the Earth in N, `seconds` after `epoch`."""
    anomaly, perigee = _angles_at(epoch.sun_angles, _SUN_ANGLES, seconds)
    longitude = perigee + anomaly
    longitude = longitude + _ARCSECOND * (6892.0 * jnp.sin(anomaly) + 72.0 * jnp.sin(2.0 * anomaly))
    distance = 1e9 * (149.619 - 2.499 * jnp.cos(anomaly) - 0.021 * jnp.cos(2.0 * anomaly))
    return _equatorial(longitude, jnp.zeros_like(longitude), distance)


def moon_position(seconds: Scalar, epoch: Epoch = J2000) -> Vector:
    """Position [m] of the Moon from the Earth in N, `seconds` after `epoch`."""
    mean, *delaunay = _angles_at(epoch.moon_angles, _MOON_ANGLES, seconds)
    arguments = jnp.stack(delaunay)
    longitude_correction = _ARCSECOND * _series(_MOON_LONGITUDE, arguments, jnp.sin)
    latitude_correction = _ARCSECOND * (412.0 * jnp.sin(2.0 * arguments[2]) + 541.0 * jnp.sin(arguments[1]))
    latitude = _ARCSECOND * (
        18520.0 * jnp.sin(arguments[2] + longitude_correction + latitude_correction)
        + _series(_MOON_LATITUDE, arguments, jnp.sin)
    )
    distance = 1e3 * (385000.0 + _series(_MOON_DISTANCE, arguments, jnp.cos))
    return _equatorial(mean + longitude_correction, latitude, distance)


def _angles_at(at_epoch: Array | np.ndarray, rows: tuple[tuple[float, float], ...], seconds: Scalar) -> list[Scalar]:
    """Angles [rad] from those at the epoch."""
    return [at_epoch[place] + math.radians(rate) / _CENTURY * seconds for place, (_, rate) in enumerate(rows)]


def _series(
    rows: tuple[tuple[int, ...], ...], arguments: Float[Array, "4"], function: Callable[[Array], Array]
) -> Scalar:
    """Sum of a trigonometric series."""
    table = jnp.array(rows, dtype=arguments.dtype)
    return jnp.sum(table[:, 0] * function(jnp.sum(table[:, 1:] * arguments[None, :], axis=1)), axis=0)


def _equatorial(longitude: Scalar, latitude: Scalar, distance: Scalar) -> Vector:
    """Equatorial components of a position in ecliptic coordinates."""
    x = jnp.cos(latitude) * jnp.cos(longitude)
    y = jnp.cos(latitude) * jnp.sin(longitude)
    z = jnp.sin(latitude)
    c, s = jnp.cos(_OBLIQUITY), jnp.sin(_OBLIQUITY)
    return distance * jnp.stack([x, c * y - s * z, s * y + c * z])
