"""Whether there is light to see the target by: at the start, and over an orbit at the station."""

import numpy as np

from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.orbit_geometry import (
    RADIUS_EARTH,
    hill_frames,
    radius,
    sun_direction,
    true_anomalies,
)

_LEAST_OF_ORBIT = 0.25
"""Share of an orbit in which the target is to be seen from the station."""
_MOST_OF_STARTS = 0.05
"""Share of the possible starts in which the target may be unseen."""
_POINTS = 360


def light_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Too small a share of the orbit with a view of the target from the station, too many starts without one."""
    found = []
    nodes = dict.fromkeys(float(each) for each in (*reach.ends("orbit.raan_deg"), reach.middle("orbit.raan_deg")))
    around = true_anomalies(file.orbit.eccentricity, _POINTS)
    low, high = reach.ends("orbit.true_anomaly_deg")
    starts = np.radians(np.linspace(low, high, _POINTS if high > low else 1))
    for key, anomalies, what, most in (
        ("formation.desired_position_m", around, "of an orbit at the station", 1.0 - _LEAST_OF_ORBIT),
        ("initial.relative_position_m", starts, "of the starts", _MOST_OF_STARTS),
    ):
        blocked = [_blocked(file, reach, reach.middle(key), node, anomalies) for node in nodes]
        worst = max(blocked, key=lambda each: np.any(each, axis=0).mean())
        share = float(np.any(worst, axis=0).mean())
        if share > most:
            dark, phase, glare = 100.0 * worst.mean(axis=1)
            found.append(
                f"{key}: the target cannot be seen in {100.0 * share:.0f} % {what} (eclipse {dark:.0f} %, phase angle "
                f"{phase:.0f} %, Sun near the line of sight {glare:.0f} %), expected at most {100.0 * most:.0f} %"
            )
    return found


def _blocked(
    file: ScenarioFile, reach: DispersedReach, place_H: np.ndarray, raan_deg: float, anomalies: np.ndarray
) -> np.ndarray:
    """(3, n) where the target is in the Earth's shadow, its phase angle too large, or the Sun too near to it."""
    frames, sun = hill_frames(file, reach, raan_deg, anomalies), sun_direction(file.epoch_utc)
    sunward = frames[:, 0] @ sun
    height = radius(file, anomalies)
    dark = (sunward < 0.0) & (height * np.sqrt(1.0 - sunward**2) < RADIUS_EARTH)
    cosine = np.einsum("nij,i->nj", frames, place_H / max(float(np.linalg.norm(place_H)), 1e-9)) @ sun
    phase = cosine < np.cos(np.radians(reach.low("camera.phase_limit_deg")))
    glare = -cosine > np.cos(np.radians(reach.high("camera.sun_exclusion_deg")))
    return np.stack([dark, phase, glare])
