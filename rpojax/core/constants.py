"""Physical constants of the Earth, SI (EGM-96 and WGS-84 values as Basilisk and most flight software use them)."""

from typing import Final

MU_EARTH: Final = 3.986004418e14
"""Gravitational parameter of the Earth [m^3/s^2]."""

RADIUS_EARTH: Final = 6378137.0
"""Equatorial radius of the Earth [m]."""

J2_EARTH: Final = 1.08262668e-3
"""Second zonal harmonic of the Earth, unnormalised [-]."""

STANDARD_GRAVITY: Final = 9.80665
"""Standard gravity that defines specific impulse [m/s^2]."""
