"""Orbits against their invariants, the potential in sixty digits, and scipy."""

from decimal import Decimal

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from high_precision_gravity import field_difference, potential_gradient, sixty_digits
from hypothesis import given
from hypothesis import strategies as st
from numpy_reference import MU, SEEDS, gravity, random_unit, relative_error
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.numerics.runge_kutta import rk4
from rpojax.core.orbits import clohessy_wiltshire, keplerian_elements, two_body_gravity, zonal_gravity
from rpojax.core.orbits.keplerian_elements import KeplerianElements
from rpojax.core.orbits.zonal_gravity import EARTH_GRAVITY

DEGREES = (0, 2, 3, 4, 5, 6)

gravity_gradient = jax.jit(two_body_gravity.gravity_gradient)
mean_motion = jax.jit(keplerian_elements.mean_motion)
relative_transition = jax.jit(clohessy_wiltshire.transition_matrix)
semi_major_axis = jax.jit(keplerian_elements.semi_major_axis)


_pull = jax.jit(zonal_gravity.gravity, static_argnums=1)


def pull(degree: int, r: np.ndarray, change: np.ndarray | None = None) -> Difference:
    """Gravity of the package at `r` and its change over `change` [m]."""
    return _pull(EARTH_GRAVITY, degree, Difference(value=r, change=np.zeros(3) if change is None else change))


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


def random_position(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(6.6e6, 4.2e7) * random_unit(rng)


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
def test_a_state_from_elements_has_their_energy_momentum_and_perigee(seed: int) -> None:
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


def test_the_mean_motion_of_the_geostationary_orbit_is_one_sidereal_day() -> None:
    # 42164.17 km and 86164.1 s are published to six digits.
    np.testing.assert_allclose(2 * np.pi / mean_motion(np.float64(42164.17e3)), 86164.1, rtol=1e-6)


@pytest.mark.parametrize("degree", DEGREES)
@given(SEEDS)
def test_gravity_is_the_gradient_of_the_potential_with_zonal_harmonics(degree: int, seed: int) -> None:
    r = random_position(np.random.default_rng(seed))
    with sixty_digits():
        expected = np.array(potential_gradient([Decimal(float(x)) for x in r], degree), dtype=float)
    assert relative_error(np.asarray(pull(degree, r).value), expected) < 1e-14


@pytest.mark.parametrize("n", [2, 3, 4, 5, 6])
def test_each_harmonic_is_right_by_itself_and_at_the_poles_and_the_equator(n: int) -> None:
    """A millionth of gravity needs a test of its own: the harmonic alone, against the difference of two potentials."""
    alone = tuple(1e3 * J if k == n else 0.0 for k, J in enumerate(EARTH_GRAVITY.zonals, start=2))
    field = zonal_gravity.GravityField(mu=EARTH_GRAVITY.mu, radius=EARTH_GRAVITY.radius, zonals=alone)
    for r in ([0.0, 0.0, 7e6], [0.0, 0.0, -7e6], [7e6, 0.0, 0.0], [3e6, -4e6, 5e6], [-2e6, 5e6, -4.5e6]):
        with sixty_digits():
            place = [Decimal(x) for x in r]
            all_ = potential_gradient(place, 0, tuple(Decimal(J) for J in alone))
            full = potential_gradient(place, n, tuple(Decimal(J) for J in alone))
            expected = np.array([a - b for a, b in zip(full, all_, strict=True)], dtype=float)
        both = [_pull(field, degree, Difference(value=np.array(r), change=np.zeros(3))).value for degree in (n, 0)]
        found = np.asarray(both[0] - both[1])
        # The harmonic is cut out of gravity, which is 8 m/s^2 with sixteen digits.
        np.testing.assert_allclose(found, expected, atol=1e-14)
        assert np.max(np.abs(expected)) > 1e-4


@pytest.mark.parametrize("degree", DEGREES)
@given(SEEDS, st.floats(-3.0, 6.0))
def test_differential_gravity_is_the_difference_of_absolute_gravities_at_any_distance(
    degree: int, seed: int, power: float
) -> None:
    rng = np.random.default_rng(seed)
    r, d = random_position(rng), 10.0**power * random_unit(rng)
    expected = field_difference(lambda place: potential_gradient(place, degree), r, d)
    # Asked for is 1e-9; without cancellation the formula gives all but the last two or three digits.
    assert relative_error(np.asarray(pull(degree, r, d).change), expected) < 1e-12


@pytest.mark.parametrize("degree", [2, 6])
@given(SEEDS, st.floats(3.0, 6.0))
def test_gravity_and_its_change_add_up_to_gravity_at_the_other_end(degree: int, seed: int, power: float) -> None:
    rng = np.random.default_rng(seed)
    r, d = random_position(rng), 10.0**power * random_unit(rng)
    here, there = pull(degree, r, d), pull(degree, r + d)
    assert relative_error(np.asarray(here.value + here.change), np.asarray(there.value)) < 1e-14


@pytest.mark.parametrize("degree", DEGREES)
@given(SEEDS)
def test_the_target_itself_is_a_fixed_point_of_the_relative_motion(degree: int, seed: int) -> None:
    r = random_position(np.random.default_rng(seed))
    np.testing.assert_array_equal(pull(degree, r).change, np.zeros(3))


def test_the_zonal_harmonics_are_the_published_ones() -> None:
    # EGM-96, fully normalised coefficients C20 to C60, times -sqrt(2n + 1).
    normalised = [-0.484165371736e-3, 0.957254173792e-6, 0.539873863789e-6, 0.685323475630e-7, -0.149957994714e-6]
    published = [-np.sqrt(2 * n + 1) * c for n, c in enumerate(normalised, start=2)]
    np.testing.assert_allclose(EARTH_GRAVITY.zonals, published, rtol=1e-6)


@given(SEEDS)
def test_the_gravity_gradient_is_differential_two_body_gravity_per_metre(seed: int) -> None:
    r, h = random_position(np.random.default_rng(seed)), 10.0

    def two_body(x: np.ndarray) -> np.ndarray:
        return -MU * x / np.linalg.norm(x) ** 3

    columns = [(two_body(r + h * e) - two_body(r - h * e)) / (2 * h) for e in np.eye(3)]
    # Central difference: rounding 1e-16 r / h = 1e-10.
    assert relative_error(np.asarray(gravity_gradient(r)), np.stack(columns, axis=1)) < 1e-8


@pytest.mark.parametrize("seconds", [0.0, 1.0, 200.0, 3000.0])
def test_the_relative_transition_is_the_exponential_of_the_clohessy_wiltshire_equations(seconds: float) -> None:
    n = 1.1e-3
    A = np.zeros((6, 6))
    A[:3, 3:] = np.eye(3)
    A[3, 0], A[5, 2], A[3, 4], A[4, 3] = 3 * n * n, -n * n, 2 * n, -2 * n
    np.testing.assert_allclose(relative_transition(np.float64(n), np.float64(seconds)), expm(A * seconds), atol=1e-8,
                               rtol=1e-9)  # fmt: skip


@jax.jit
def fly(r: jax.Array, v: jax.Array) -> tuple[jax.Array, jax.Array]:
    """One orbit of 5400 s in steps of 1 s."""

    none = jnp.zeros(3)

    def derivative(y: tuple[jax.Array, jax.Array], _: jax.Array) -> tuple[jax.Array, jax.Array]:
        return y[1], zonal_gravity.gravity(EARTH_GRAVITY, 2, Difference(value=y[0], change=none)).value

    def body(y: tuple[jax.Array, jax.Array], _: None) -> tuple[tuple[jax.Array, jax.Array], None]:
        return rk4(derivative, y, none, 1.0), None

    return jax.lax.scan(body, (r, v), None, length=5400)[0]


def test_an_oblate_orbit_agrees_with_scipy_after_a_revolution() -> None:
    r, v = np.array([6.8e6, 1.0e5, -2.0e5]), np.array([100.0, 4000.0, 6500.0])
    found_r, found_v = fly(r, v)
    solution = solve_ivp(
        lambda _, y: np.concatenate([y[3:], gravity(y[:3])]), (0.0, 5400.0), np.concatenate([r, v]), "DOP853",
        rtol=1e-13, atol=1e-6,
    )  # fmt: skip
    expected = solution.y[:, -1]
    # Both integrators are good to about 1e-5 m here; J2 alone moves the satellite by 30 km.
    np.testing.assert_allclose(found_r, expected[:3], atol=1e-4)
    np.testing.assert_allclose(found_v, expected[3:], atol=1e-7)
