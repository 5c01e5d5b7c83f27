"""Whether there is light to see the target by: at the start, and over an orbit at the station."""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from rpojax.core.frames import hill_frame
from rpojax.core.orbits import camera_visibility, sun_moon_ephemeris
from rpojax.core.orbits.keplerian_elements import KeplerianElements, state_from_elements
from rpojax.core.pytree import replace
from rpojax.core.vectors import apply_transposed
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.scenario.warnings.nominal_motion import latitudes_after, mean_motion
from rpojax.sensors.additional.registry import present_sensors
from rpojax.value_types import epoch_seconds

_LEAST_OF_ORBIT = 0.25
"""Share of an orbit in which the target is to be seen from the station."""
_MOST_OF_STARTS = 0.05
"""Share of the possible starts in which the target may be unseen."""
_POINTS = 360


def light_warnings(file: ScenarioFile, reach: DispersedReach) -> list[str]:
    """Too small a share of the orbit with a view of the target from the station, too many starts without one.

    Nothing where a sensor that needs no light shows the direction of the target.
    """
    if any(sensor.shows_direction for sensor in present_sensors(file).values()):
        return []
    found = []
    nodes = dict.fromkeys(float(each) for each in (*reach.ends("orbit.raan_deg"), reach.middle("orbit.raan_deg")))
    perigee = math.radians(file.orbit.argument_of_perigee_deg)
    times = 2.0 * math.pi / mean_motion(file) * np.arange(_POINTS) / _POINTS
    around = latitudes_after(file, perigee, times) - perigee
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


def unseen_places(file: ScenarioFile, reach: DispersedReach, place_H: np.ndarray) -> np.ndarray:
    """(360,) whether the target cannot be seen from a place in H [m], at equal steps of true anomaly from zero."""
    anomalies = 2.0 * math.pi * np.arange(_POINTS) / _POINTS
    return np.any(_blocked(file, reach, place_H, file.orbit.raan_deg, anomalies), axis=0)


def _blocked(
    file: ScenarioFile, reach: DispersedReach, place_H: np.ndarray, raan_deg: float, anomalies: np.ndarray
) -> np.ndarray:
    """(3, n) where the target is in the Earth's shadow, its phase angle too large, or the Sun too near to it."""
    degrees = {
        "inclination": reach.middle("orbit.inclination_deg"),
        "raan": raan_deg,
        "argument_of_perigee": reach.middle("orbit.argument_of_perigee_deg"),
        "true_anomaly": 0.0,
    }
    elements = KeplerianElements(
        semi_major_axis=jnp.float64(file.orbit.semi_major_axis_m),
        eccentricity=jnp.float64(file.orbit.eccentricity),
        **{name: jnp.float64(np.radians(angle)) for name, angle in degrees.items()},
    )
    limits = np.radians([reach.low("camera.phase_limit_deg"), reach.high("camera.sun_exclusion_deg")])
    seconds = epoch_seconds(file.epoch_utc)
    dark, phase, glare = ~np.asarray(_conditions(elements, anomalies, np.asarray(place_H), seconds, limits))
    if file.lamp is not None and float(np.linalg.norm(place_H)) <= reach.low("lamp.reach_m"):
        # A Sun near the line of sight blinds the camera even so, but for one behind the Earth.
        return np.stack([np.zeros_like(dark), np.zeros_like(phase), glare & ~dark])
    return np.stack([dark, phase, glare])


@jax.jit
def _conditions(
    elements: KeplerianElements,
    anomalies: Float[Array, " n"],
    place_H: Float[Array, "3"],
    seconds: Float[Array, ""],
    limits: Float[Array, "2"],
) -> Bool[Array, "3 n"]:
    """`viewing_conditions` of the target at true anomalies [rad], with the Sun where it is at a time [s]."""
    sun_N = sun_moon_ephemeris.sun_position(seconds)

    def conditions(anomaly: Array) -> Array:
        r_TN_N, v_TN_N = state_from_elements(replace(elements, true_anomaly=anomaly))
        r_ST_N = apply_transposed(hill_frame(r_TN_N, v_TN_N)[0], place_H)
        return jnp.stack(camera_visibility.viewing_conditions(r_TN_N, r_ST_N, sun_N, limits[0], limits[1]))

    return jax.vmap(conditions, out_axes=1)(anomalies)
