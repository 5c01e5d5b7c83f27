"""Positions in and around the Earth's penumbra."""

import numpy as np
from gradient_checks import V
from numpy_reference import unit
from scipy.optimize import brentq

SUN_N = np.array([1.2e11, 0.0, 9e10])


def behind(distance: float, off_axis: float) -> np.ndarray:
    """Position [m] behind the Earth at a distance from its centre and an angle [rad] off the axis of the shadow."""
    axis, across = -unit(SUN_N), unit(np.cross(SUN_N, V))
    return distance * (np.cos(off_axis) * axis + np.sin(off_axis) * across)


def touching(distance: float, inner: bool, sun_radius: float = 7e8) -> float:
    """Angle [rad] between the axis of the shadow and the inner or outer border of the penumbra."""

    def gap(angle: float) -> float:
        r = behind(distance, angle)
        to_sun = SUN_N - r
        sun, earth = np.arcsin(sun_radius / np.linalg.norm(to_sun)), np.arcsin(6378137.0 / distance)
        apart = np.arctan2(np.linalg.norm(np.cross(to_sun, r)), -to_sun @ r)
        return apart - (abs(earth - sun) if inner else earth + sun)

    return brentq(gap, 0.0, np.pi / 2, xtol=1e-15)
