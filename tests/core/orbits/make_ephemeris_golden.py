"""Writes `ephemeris_golden.csv`: Sun and Moon by the IAU's routines (pyerfa: epv00 of VSOP2000, moon98 of ELP).

Usage: `pip install pyerfa` and `python tests/core/orbits/make_ephemeris_golden.py`.
"""

from pathlib import Path

import erfa
import numpy as np

DAY = 86400.0
J2000 = 2451545.0
STEP_DAYS = 97.3  # no simple ratio to a month or a year
SPAN_DAYS = 35 * 365.25


def positions(days: float) -> np.ndarray:
    """Geocentric positions of Sun and Moon [m], `days` after 2000-01-01 12:00 terrestrial time, equator of J2000.

    Terrestrial and barycentric time differ by 2 ms, and the axes of J2000 and of the ICRS by 0.02 arcsec.
    """
    heliocentric, _ = erfa.epv00(J2000, days)
    moon = erfa.moon98(J2000, days)
    return np.concatenate([-heliocentric["p"], moon["p"]]) * erfa.DAU


def main() -> None:
    """Rows of seconds after J2000, Sun [m], Moon [m]."""
    days = np.arange(0.0, SPAN_DAYS, STEP_DAYS)
    rows = np.array([[DAY * day, *positions(day)] for day in days])
    header = "seconds,sun_x,sun_y,sun_z,moon_x,moon_y,moon_z"
    np.savetxt(Path(__file__).with_name("ephemeris_golden.csv"), rows, "%.0f", ",", header=header, comments="")


if __name__ == "__main__":
    main()
