"""Physical constants in SI units (of the Earth: EGM-96 and WGS-84, as in Basilisk and others), and rounding."""

from typing import Final

MU_EARTH: Final = 3.986004418e14
"""Gravitational parameter of the Earth [m^3/s^2]."""

RADIUS_EARTH: Final = 6378137.0
"""Equatorial radius of the Earth [m]."""

J2_EARTH: Final = 1.08262668e-3
"""Second zonal harmonic of the Earth, unnormalised [-]."""

STANDARD_GRAVITY: Final = 9.80665
"""Standard gravity that defines specific impulse [m/s^2]."""

ZONALS_EARTH: Final = (J2_EARTH, -2.53265649e-6, -1.61962159e-6, -2.27296083e-7, 5.40681239e-7)
"""Zonal harmonics J2 to J6 of the Earth, unnormalised [-]."""

MU_SUN: Final = 1.32712440018e20
"""Gravitational parameter of the Sun [m^3/s^2]."""

MU_MOON: Final = 4.9028e12
"""Gravitational parameter of the Moon [m^3/s^2]."""

RADIUS_SUN: Final = 6.957e8
"""Radius of the Sun's visible disc [m]."""

ASTRONOMICAL_UNIT: Final = 1.495978707e11
"""Distance at which the solar flux is given [m]."""

SOLAR_FLUX: Final = 1361.0
"""Solar flux at one astronomical unit (Kopp and Lean, 2011) [W/m^2]."""

SPEED_OF_LIGHT: Final = 299792458.0
"""Speed of light in vacuum [m/s]."""
