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


def latitudes_after(file: ScenarioFile, start: float, times: np.ndarray) -> np.ndarray:
    """Arguments of latitude (t,) [rad] at `times` (t,) [s] after that at the `start`; they count whole turns on."""
    e, perigee = file.orbit.eccentricity, np.radians(file.orbit.argument_of_perigee_deg)
    eta = np.sqrt(1.0 - e * e)
    true = start - perigee
    eccentric = true - 2.0 * np.arctan2(e * np.sin(true), 1.0 + eta + e * np.cos(true))
    mean = eccentric - e * np.sin(eccentric) + mean_motion(file) * np.asarray(times, dtype=np.float64)
    turns = 2.0 * np.pi * np.round(mean / (2.0 * np.pi))
    within = mean - turns
    # From above the solution in the half-turn where Kepler's equation is convex Newton's method does not overshoot.
    bound = np.minimum(np.minimum(np.abs(within) + e, np.abs(within) / (1.0 - e)), np.pi)
    later = np.copysign(bound, within)
    for _ in range(12):
        later = later - (later - e * np.sin(later) - within) / (1.0 - e * np.cos(later))
    lead = 2.0 * np.arctan2(e * np.sin(later), 1.0 + eta - e * np.cos(later))
    return np.asarray(perigee + turns + later + lead)


def motions_between(file: ScenarioFile, start: float, times: np.ndarray) -> np.ndarray:
    """(t, 6, 6) transition matrices of (rho, rho_dot) in H over `times` (t,) [s] from an argument of latitude [rad].

    By Yamanaka and Ankersen, as `core.orbits.yamanaka_ankersen`, whose import takes JAX.
    """
    times = np.asarray(times, dtype=np.float64)
    motions = _motions_of_constants(file, latitudes_after(file, start, times), times)
    return motions @ np.linalg.inv(_motions_of_constants(file, np.array([start]), np.zeros(1))[0])


def _motions_of_constants(file: ScenarioFile, u: np.ndarray, since: np.ndarray) -> np.ndarray:
    """(t, 6, 6) states of the six free motions at arguments of latitude (t,) [rad], a time (t,) [s] after the epoch."""
    e, perigee = file.orbit.eccentricity, np.radians(file.orbit.argument_of_perigee_deg)
    ex, ey = e * np.cos(perigee), e * np.sin(perigee)
    c, s, zero = np.cos(u), np.sin(u), np.zeros_like(u)
    kappa, slope = 1.0 + ex * c + ey * s, ey * c - ex * s
    unit = mean_motion(file) * (1.0 - e * e) ** -1.5
    tau, far = since * unit, slope / kappa**2
    position = [
        [zero, -c, -s, -2.0 / kappa - 3.0 * slope * tau, zero, zero],
        [1.0 / kappa, (1.0 + 1.0 / kappa) * s, -(1.0 + 1.0 / kappa) * c, 3.0 * kappa * tau, zero, zero],
        [zero, zero, zero, zero, s / kappa, -c / kappa],
    ]
    by_latitude = [
        [zero, s, -c, -far - 3.0 * (1.0 - kappa) * tau, zero, zero],
        [
            -far,
            (1.0 + 1.0 / kappa) * c - far * s,
            (1.0 + 1.0 / kappa) * s + far * c,
            3.0 / kappa + 3.0 * slope * tau,
            zero,
            zero,
        ],
        [zero, zero, zero, zero, c / kappa - far * s, s / kappa + far * c],
    ]
    rates = np.broadcast_to(unit * kappa**2, (3, 6, len(u)))
    return np.concatenate([np.array(position), np.array(by_latitude) * rates]).transpose(2, 0, 1)


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
