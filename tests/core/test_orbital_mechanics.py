"""Orbits against their invariants, exact rational arithmetic, finite differences of the potential, and scipy."""

from decimal import Decimal, localcontext

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference import J2, MU, RADIUS, SEEDS, gravity, random_unit, relative_error
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from rpojax.core import orbital_mechanics
from rpojax.core.integrate import rk4
from rpojax.core.orbital_mechanics import Elements

differential_gravity = jax.jit(orbital_mechanics.differential_gravity)
gravity_gradient = jax.jit(orbital_mechanics.gravity_gradient)
mean_motion = jax.jit(orbital_mechanics.mean_motion)
relative_transition = jax.jit(orbital_mechanics.relative_transition)
rpojax_gravity = jax.jit(orbital_mechanics.gravity)
semi_major_axis = jax.jit(orbital_mechanics.semi_major_axis)


@jax.jit
def state_from_elements(elements: jax.Array) -> tuple[jax.Array, jax.Array]:
    a, e, i, raan, w, nu = elements
    return orbital_mechanics.state_from_elements(
        Elements(semi_major_axis=a, eccentricity=e, inclination=i, raan=raan, argument_of_perigee=w, true_anomaly=nu)
    )


def random_elements(rng: np.random.Generator) -> np.ndarray:
    angles = rng.uniform([0.1, 0.0, 0.0, 0.0], [3.0, 2 * np.pi, 2 * np.pi, 2 * np.pi])
    return np.concatenate([[rng.uniform(6.8e6, 4.0e7), rng.uniform(0.01, 0.8)], angles])


def random_position(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(6.6e6, 4.2e7) * random_unit(rng)


def exact_gravity(r: list[Decimal]) -> list[Decimal]:
    square = sum(x * x for x in r)
    distance = square.sqrt()
    two_body = -Decimal(MU) / (square * distance)
    factor = Decimal("1.5") * Decimal(J2) * Decimal(MU) * Decimal(RADIUS) ** 2 / (square * square * distance)
    ratio = 5 * r[2] * r[2] / square
    return [x * (two_body - factor * (k - ratio)) for x, k in zip(r, (1, 1, 3), strict=True)]


def exact_differential_gravity(r: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Difference of the two absolute accelerations in 60 digits, so that its cancellation does not matter."""
    with localcontext(prec=60):
        near = [Decimal(float(x)) for x in r]
        far = [x + Decimal(float(y)) for x, y in zip(near, d, strict=True)]
        pairs = zip(exact_gravity(far), exact_gravity(near), strict=True)
        return np.array([float(a - b) for a, b in pairs])


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


@given(SEEDS)
def test_gravity_is_the_gradient_of_the_potential_with_j2(seed: int) -> None:
    r = random_position(np.random.default_rng(seed)).astype(np.longdouble)

    def potential(x: np.ndarray) -> np.longdouble:
        distance = np.sqrt(np.sum(x * x))
        oblate = np.longdouble(J2) * (RADIUS / distance) ** 2 * (3 * (x[2] / distance) ** 2 - 1) / 2
        return np.longdouble(MU) / distance * (1 - oblate)

    h = np.longdouble(100.0)
    steps = h * np.eye(3, dtype=np.longdouble)
    slope = np.array([(potential(r + s) - potential(r - s)) / (2 * h) for s in steps], dtype=float)
    # Truncation of the central difference: (h / r)^2 = 2e-10.
    assert relative_error(np.asarray(rpojax_gravity(r.astype(float))), slope) < 1e-9


@given(SEEDS, st.floats(-3.0, 6.5))
def test_differential_gravity_is_the_difference_of_absolute_gravities_at_any_distance(seed: int, power: float) -> None:
    rng = np.random.default_rng(seed)
    r, d = random_position(rng), 10.0**power * random_unit(rng)
    # Asked for is 1e-9; without cancellation the formula gives all but the last two or three digits.
    assert relative_error(np.asarray(differential_gravity(r, d)), exact_differential_gravity(r, d)) < 1e-12


@given(SEEDS)
def test_the_target_itself_is_a_fixed_point_of_the_relative_motion(seed: int) -> None:
    r = random_position(np.random.default_rng(seed))
    np.testing.assert_array_equal(differential_gravity(r, np.zeros(3)), np.zeros(3))


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

    none = jnp.zeros(())

    def derivative(y: tuple[jax.Array, jax.Array], _: jax.Array) -> tuple[jax.Array, jax.Array]:
        return y[1], orbital_mechanics.gravity(y[0])

    def body(y: tuple[jax.Array, jax.Array], _: None) -> tuple[tuple[jax.Array, jax.Array], None]:
        return rk4(derivative, y, (none, none, none), 1.0), None

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
