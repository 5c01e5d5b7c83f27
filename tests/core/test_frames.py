"""Hill frame and camera frame against worked cases and their own definitions."""

import jax
import numpy as np
from hypothesis import given
from numpy_reference import SEEDS, random_unit

from rpojax.core import frames

EXACT = 1e-14  # a few roundings of numbers near one

hill_frame = jax.jit(frames.hill_frame)
hill_to_inertial = jax.jit(frames.hill_to_inertial)
inertial_to_hill = jax.jit(frames.inertial_to_hill)
look_at = jax.jit(frames.look_at)


def random_orbit(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    r = 7.0e6 * random_unit(rng)
    return r, 7500.0 * random_unit(rng)


def test_hill_axes_of_an_orbit_in_the_equator_are_the_inertial_axes_at_perigee_on_x() -> None:
    R_HN, omega = hill_frame(np.array([7.0e6, 0.0, 0.0]), np.array([0.0, 7500.0, 0.0]))
    np.testing.assert_allclose(R_HN, np.eye(3), atol=EXACT)
    np.testing.assert_allclose(omega, [0.0, 0.0, 7500.0 / 7.0e6], rtol=EXACT)


def test_hill_axes_of_a_polar_orbit_are_radial_along_track_and_normal() -> None:
    R_HN, omega = hill_frame(np.array([0.0, 7.0e6, 0.0]), np.array([0.0, 0.0, 7500.0]))
    np.testing.assert_allclose(R_HN, [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], atol=EXACT)
    np.testing.assert_allclose(omega, [7500.0 / 7.0e6, 0.0, 0.0], rtol=EXACT)


@given(SEEDS)
def test_hill_axes_are_orthonormal_and_right_handed_on_any_orbit(seed: int) -> None:
    R_HN = np.asarray(hill_frame(*random_orbit(np.random.default_rng(seed)))[0])
    np.testing.assert_allclose(R_HN @ R_HN.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R_HN) > 0.99


def test_the_hill_rate_is_the_angular_rate_of_the_hill_axes() -> None:
    r, v, h = np.array([5.0e6, 4.0e6, 2.5e6]), np.array([-3000.0, 2000.0, 6500.0]), 1e-3
    acceleration = -3.986004418e14 * r / np.linalg.norm(r) ** 3  # central, so the orbit plane stands still
    R, omega = (np.asarray(x) for x in hill_frame(r, v))
    after, before = (np.asarray(hill_frame(r + s * h * v + 0.5 * h * h * acceleration, v + s * h * acceleration)[0])
                     for s in (1.0, -1.0))  # fmt: skip
    rate = (after - before) / (2 * h)
    minus_omega_cross = rate @ R.T
    np.testing.assert_allclose(
        [minus_omega_cross[1, 2], minus_omega_cross[2, 0], minus_omega_cross[0, 1]],
        R @ omega,
        atol=1e-12,  # rounding 1e-16 / h, against a rate of 1e-3
    )


@given(SEEDS)
def test_hill_to_inertial_is_inverted_by_inertial_to_hill(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axes = hill_frame(*random_orbit(rng))
    rho, rho_dot = 100.0 * rng.normal(size=3), 0.1 * rng.normal(size=3)
    back = inertial_to_hill(*hill_to_inertial(rho, rho_dot, *axes), *axes)
    np.testing.assert_allclose(back[0], rho, atol=1e-11)
    np.testing.assert_allclose(back[1], rho_dot, atol=1e-12)


def test_a_point_at_rest_in_the_hill_frame_moves_with_its_rate() -> None:
    axes = hill_frame(np.array([7.0e6, 0.0, 0.0]), np.array([0.0, 7000.0, 0.0]))
    r_N, v_N = hill_to_inertial(np.array([0.0, -50.0, 0.0]), np.zeros(3), *axes)
    np.testing.assert_allclose(r_N, [0.0, -50.0, 0.0], atol=EXACT)
    np.testing.assert_allclose(v_N, [50.0 * 1e-3, 0.0, 0.0], atol=EXACT)


@given(SEEDS)
def test_look_at_points_the_boresight_and_brings_the_x_axis_nearest_to_the_given_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    direction, right = random_unit(rng), random_unit(rng)
    R_KN = np.asarray(look_at(direction, right))
    np.testing.assert_allclose(R_KN @ R_KN.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R_KN) > 0.99
    np.testing.assert_allclose(R_KN[2], direction, atol=EXACT)
    across = right - (right @ direction) * direction
    np.testing.assert_allclose(R_KN[0] @ right, np.linalg.norm(across), atol=1e-12)
