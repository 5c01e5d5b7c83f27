"""Orbit and light of the warnings are those of the simulation."""

import jax.numpy as jnp
import numpy as np

from rpojax.core.frames import hill_frame
from rpojax.core.orbits import camera_visibility, keplerian_elements, sun_moon_ephemeris
from rpojax.core.orbits.keplerian_elements import KeplerianElements
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings import nominal_motion, target_light
from rpojax.scenario.warnings.dispersed_reach import DispersedReach
from rpojax.value_types import epoch_seconds

ECCENTRIC = ["orbit.eccentricity=0.1", "orbit.semi_major_axis_m=7.8e6", "orbit.raan_deg=20.0"]


def elements(file: ScenarioFile, true_anomaly: float) -> KeplerianElements:
    """Elements of a scenario's orbit at a true anomaly [rad]."""
    orbit = file.orbit
    angles = (orbit.inclination_deg, orbit.raan_deg, orbit.argument_of_perigee_deg)
    inclination, raan, perigee = (jnp.asarray(np.radians(angle)) for angle in angles)
    return KeplerianElements(
        semi_major_axis=jnp.asarray(orbit.semi_major_axis_m),
        eccentricity=jnp.asarray(orbit.eccentricity),
        inclination=inclination,
        raan=raan,
        argument_of_perigee=perigee,
        true_anomaly=jnp.asarray(true_anomaly),
    )


def test_places_at_equal_times_sweep_equal_areas() -> None:
    file = scenario_loader.load("inspection", ECCENTRIC)
    perigee = np.radians(file.orbit.argument_of_perigee_deg)
    times = 2.0 * np.pi / nominal_motion.mean_motion(file) * np.arange(400) / 400
    anomalies = nominal_motion.latitudes_after(file, perigee, times) - perigee
    middle = 0.5 * (anomalies[1:] + anomalies[:-1])
    areas = np.diff(anomalies) / (1.0 + 0.1 * np.cos(middle)) ** 2
    np.testing.assert_allclose(areas, areas.mean(), rtol=1e-4)


def test_light_is_judged_as_in_the_simulation() -> None:
    file = scenario_loader.load("inspection", [*ECCENTRIC, "camera.phase_limit_deg=110.0"])
    place = np.array([10.0, -30.0, 5.0])
    anomalies = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False) + 0.01
    blocked = target_light._blocked(file, DispersedReach(file), place, file.orbit.raan_deg, anomalies)
    sun = sun_moon_ephemeris.sun_position(jnp.zeros(()), sun_moon_ephemeris.epoch_at(epoch_seconds(file.epoch_utc)))
    limits = (jnp.radians(jnp.asarray(each)) for each in (110.0, file.camera.sun_exclusion_deg))
    phase_limit, exclusion = limits
    expected = []
    for anomaly in anomalies:
        r_N, v_N = keplerian_elements.state_from_elements(elements(file, anomaly))
        r_ST_N = hill_frame(r_N, v_N)[0].T @ place
        expected.append(bool(camera_visibility.is_observable(r_N, r_ST_N, sun, phase_limit, exclusion)))
    assert 10 < np.sum(expected) < 80
    np.testing.assert_array_equal(~np.any(blocked, axis=0), expected)
