"""Orbit, Sun and relative motion of the warnings agree with those of the simulation."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core import constants
from rpojax.core.frames import hill_frame
from rpojax.core.orbits import camera_visibility, clohessy_wiltshire, keplerian_elements, sun_moon_ephemeris
from rpojax.core.orbits.keplerian_elements import KeplerianElements
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.warnings import orbit_geometry, target_light
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


def test_constants_are_those_of_the_simulation() -> None:
    assert (orbit_geometry.MU_EARTH, orbit_geometry.RADIUS_EARTH) == (constants.MU_EARTH, constants.RADIUS_EARTH)


def test_relative_motion_is_that_of_the_simulation() -> None:
    n, times = 1.1e-3, np.array([0.0, 200.0, 3000.0])
    for time, found in zip(times, orbit_geometry.transition_matrices(n, times), strict=True):
        expected = clohessy_wiltshire.transition_matrix(jnp.asarray(n), jnp.asarray(time))
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("epoch", ["2026-03-20T14:46:00", "2031-10-05T03:00:00"])
def test_the_sun_is_where_the_simulation_has_it(epoch: str) -> None:
    begin = sun_moon_ephemeris.epoch_at(epoch_seconds(epoch))
    expected = np.asarray(sun_moon_ephemeris.sun_position(jnp.zeros(()), begin))
    found = orbit_geometry.sun_direction(epoch)
    assert np.degrees(np.arccos(found @ expected / np.linalg.norm(expected))) < 0.2


def test_frames_and_radii_are_those_of_the_orbit() -> None:
    file = scenario_loader.load("inspection", ECCENTRIC)
    anomalies = np.array([0.3, 2.0, 5.0])
    frames = orbit_geometry.hill_frames(file, DispersedReach(file), file.orbit.raan_deg, anomalies)
    for anomaly, frame, radius in zip(anomalies, frames, orbit_geometry.radius(file, anomalies), strict=True):
        r_N, v_N = keplerian_elements.state_from_elements(elements(file, anomaly))
        np.testing.assert_allclose(frame, hill_frame(r_N, v_N)[0], atol=1e-12)
        assert radius == pytest.approx(float(jnp.linalg.norm(r_N)), rel=1e-12)


def test_equal_times_sweep_equal_areas() -> None:
    anomalies = np.unwrap(orbit_geometry.true_anomalies(0.1, 400))
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
    differing = np.sum(~np.any(blocked, axis=0) != np.array(expected))
    assert 10 < np.sum(expected) < 80
    # The penumbra, and a degree of the Sun's motion.
    assert differing <= 3
