"""Keplerian elements against energy, angular momentum and eccentricity vector of the orbit."""

import jax
import numpy as np
from hypothesis import given
from numpy_reference import MU, SEEDS

from rpojax.core.orbits import keplerian_elements
from rpojax.core.orbits.keplerian_elements import KeplerianElements

mean_motion = jax.jit(keplerian_elements.mean_motion)
semi_major_axis = jax.jit(keplerian_elements.semi_major_axis)


@jax.jit
def state_from_elements(elements: jax.Array) -> tuple[jax.Array, jax.Array]:
    a, e, i, raan, w, nu = elements
    return keplerian_elements.state_from_elements(
        KeplerianElements(
            semi_major_axis=a, eccentricity=e, inclination=i, raan=raan, argument_of_perigee=w, true_anomaly=nu
        )
    )


def random_elements(rng: np.random.Generator) -> np.ndarray:
    angles = rng.uniform([0.1, 0.0, 0.0, 0.0], [3.0, 2 * np.pi, 2 * np.pi, 2 * np.pi])
    return np.concatenate([[rng.uniform(6.8e6, 4.0e7), rng.uniform(0.01, 0.8)], angles])


def test_a_circular_equatorial_orbit_starts_on_the_x_axis_and_moves_along_y() -> None:
    r, v = state_from_elements(np.array([7.0e6, 0.0, 0.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(r, [7.0e6, 0.0, 0.0])
    np.testing.assert_allclose(v, [0.0, np.sqrt(MU / 7.0e6), 0.0])


def test_a_polar_orbit_at_its_highest_latitude_is_over_the_pole_and_moves_towards_the_descending_node() -> None:
    raan = np.deg2rad(30.0)
    r, v = state_from_elements(np.array([7.0e6, 0.0, np.pi / 2, raan, np.pi / 2, 0.0]))
    np.testing.assert_allclose(r, [0.0, 0.0, 7.0e6], atol=1e-8)
    np.testing.assert_allclose(v, -np.sqrt(MU / 7.0e6) * np.array([np.cos(raan), np.sin(raan), 0.0]), atol=1e-11)


@given(SEEDS)
def test_a_state_from_elements_has_the_right_energy_momentum_and_eccentricity_vector(seed: int) -> None:
    elements = random_elements(np.random.default_rng(seed))
    a, e, inclination, raan, w, nu = elements
    r, v = (np.asarray(x) for x in state_from_elements(elements))
    distance = np.linalg.norm(r)
    momentum = np.cross(r, v)
    perigee = np.cross(v, momentum) / MU - r / distance
    node = np.array([np.cos(raan), np.sin(raan), 0.0])
    np.testing.assert_allclose(v @ v, MU * (2 / distance - 1 / a), rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(momentum), np.sqrt(MU * a * (1 - e * e)), rtol=1e-12)
    np.testing.assert_allclose(momentum[2] / np.linalg.norm(momentum), np.cos(inclination), atol=1e-12)
    np.testing.assert_allclose([momentum @ node / np.linalg.norm(momentum), np.linalg.norm(perigee)], [0.0, e], 1e-11,
                               1e-12)  # fmt: skip
    np.testing.assert_allclose(perigee @ node, e * np.cos(w), atol=1e-12)
    np.testing.assert_allclose(perigee[2], e * np.sin(w) * np.sin(inclination), atol=1e-12)
    np.testing.assert_allclose(perigee @ r, e * distance * np.cos(nu), atol=1e-4)
    np.testing.assert_allclose(semi_major_axis(r, v), a, rtol=1e-12)


def test_the_period_of_the_geostationary_orbit_is_one_sidereal_day() -> None:
    # 42164.17 km and 86164.1 s are published to six digits.
    np.testing.assert_allclose(2 * np.pi / mean_motion(np.float64(42164.17e3)), 86164.1, rtol=1e-6)
