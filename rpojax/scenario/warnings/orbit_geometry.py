"""Orbit, Sun and free relative motion in NumPy, as accurate as warnings need and without importing JAX."""

import numpy as np

from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.value_types import epoch_seconds

MU_EARTH = 3.986004418e14
"""As in `core.constants`, whose import takes JAX [m^3/s^2]."""
RADIUS_EARTH = 6378137.0
"""As in `core.constants` [m]."""


def mean_motion(file: ScenarioFile) -> float:
    """Mean motion [rad/s] of the nominal orbit."""
    return float(np.sqrt(MU_EARTH / file.orbit.semi_major_axis_m**3))


def transition_matrices(n: float, times: np.ndarray) -> np.ndarray:
    """(t, 6, 6) transition matrices of (rho, rho_dot) in H over `times` (t,) [s], by Clohessy and Wiltshire."""
    angle = n * np.asarray(times, dtype=np.float64)
    s, c, zero, one = np.sin(angle), np.cos(angle), np.zeros_like(angle), np.ones_like(angle)
    rows = [
        [4 - 3 * c, zero, zero, s / n, 2 / n * (1 - c), zero],
        [6 * (s - angle), one, zero, -2 / n * (1 - c), (4 * s - 3 * angle) / n, zero],
        [zero, zero, c, zero, zero, s / n],
        [3 * n * s, zero, zero, c, 2 * s, zero],
        [-6 * n * (1 - c), zero, zero, -2 * s, 4 * c - 3, zero],
        [zero, zero, -n * s, zero, zero, c],
    ]
    return np.array(rows).transpose(2, 0, 1)


def sun_direction(epoch_utc: str) -> np.ndarray:
    """Unit vector (3,) from the Earth to the Sun in N, within 0.2 deg (Montenbruck and Gill, section 3.3.2)."""
    centuries = epoch_seconds(epoch_utc) / (36525.0 * 86400.0)
    anomaly = np.radians(357.5256 + 35999.049 * centuries)
    correction = (6892.0 * np.sin(anomaly) + 72.0 * np.sin(2.0 * anomaly)) / 3600.0
    longitude = np.radians(282.9400) + anomaly + np.radians(correction)
    obliquity = np.radians(23.43929111)
    return np.array([np.cos(longitude), np.sin(longitude) * np.cos(obliquity), np.sin(longitude) * np.sin(obliquity)])


def hill_frames(file: ScenarioFile, reach: DispersedReach, raan_deg: float, true_anomaly: np.ndarray) -> np.ndarray:
    """(n, 3, 3) rows are the axes of H in N, at true anomalies (n,) [rad] of the orbit with a node."""
    node, inclination = np.radians(raan_deg), np.radians(float(reach.middle("orbit.inclination_deg")))
    angle = true_anomaly + np.radians(float(reach.middle("orbit.argument_of_perigee_deg")))
    along_node = np.array([np.cos(node), np.sin(node), 0.0])
    normal = np.array([np.sin(node) * np.sin(inclination), -np.cos(node) * np.sin(inclination), np.cos(inclination)])
    across = np.cross(normal, along_node)
    radial = np.cos(angle)[:, None] * along_node + np.sin(angle)[:, None] * across
    along = np.cross(normal, radial)
    return np.stack([radial, along, np.broadcast_to(normal, radial.shape)], axis=1)


def true_anomalies(eccentricity: float, count: int) -> np.ndarray:
    """True anomalies (count,) [rad] at equal intervals of time over an orbit."""
    mean = 2.0 * np.pi * np.arange(count) / count
    eccentric = mean + eccentricity * np.sin(mean)
    for _ in range(20):
        eccentric -= (eccentric - eccentricity * np.sin(eccentric) - mean) / (1.0 - eccentricity * np.cos(eccentric))
    ratio = np.sqrt((1.0 + eccentricity) / (1.0 - eccentricity))
    return 2.0 * np.arctan(ratio * np.tan(0.5 * eccentric))


def radius(file: ScenarioFile, true_anomaly: np.ndarray) -> np.ndarray:
    """Distance (n,) [m] from the Earth's centre at true anomalies [rad]."""
    e = file.orbit.eccentricity
    return file.orbit.semi_major_axis_m * (1.0 - e * e) / (1.0 + e * np.cos(true_anomaly))
