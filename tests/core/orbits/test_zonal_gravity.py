"""Gravity with zonal harmonics against its potential in sixty digits, published coefficients, and scipy."""

from decimal import Decimal

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from high_precision_gravity import field_difference, potential_gradient, sixty_digits
from hypothesis import given
from hypothesis import strategies as st
from numpy_reference import SEEDS, random_position, random_unit, relative_error
from numpy_reference import gravity as reference_gravity
from scipy.integrate import solve_ivp

from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.numerics.runge_kutta import rk4
from rpojax.core.orbits import zonal_gravity
from rpojax.core.orbits.zonal_gravity import EARTH_GRAVITY

DEGREES = (0, 2, 3, 4, 5, 6)

_gravity = jax.jit(zonal_gravity.gravity, static_argnums=1)


def gravity(degree: int, r: np.ndarray, change: np.ndarray | None = None) -> Difference:
    """Gravity of the package at `r` and its change over `change` [m]."""
    change = np.zeros(3) if change is None else change
    return _gravity(EARTH_GRAVITY, degree, Difference(value=jnp.asarray(r), change=jnp.asarray(change)))


@pytest.mark.parametrize("degree", DEGREES)
@given(SEEDS)
def test_gravity_is_the_gradient_of_the_potential_with_zonal_harmonics(degree: int, seed: int) -> None:
    r = random_position(np.random.default_rng(seed))
    with sixty_digits():
        expected = np.array(potential_gradient([Decimal(float(x)) for x in r], degree), dtype=float)
    assert relative_error(np.asarray(gravity(degree, r).value), expected) < 1e-14


@pytest.mark.parametrize("n", [2, 3, 4, 5, 6])
def test_each_harmonic_alone_matches_its_potential_at_the_poles_the_equator_and_between(n: int) -> None:
    """A harmonic of a millionth of gravity is invisible in the sum: it is compared alone, scaled by a thousand."""
    alone = tuple(1e3 * J if k == n else 0.0 for k, J in enumerate(EARTH_GRAVITY.zonals, start=2))
    field = zonal_gravity.GravityField(mu=EARTH_GRAVITY.mu, radius=EARTH_GRAVITY.radius, zonals=alone)
    for r in ([0.0, 0.0, 7e6], [0.0, 0.0, -7e6], [7e6, 0.0, 0.0], [3e6, -4e6, 5e6], [-2e6, 5e6, -4.5e6]):
        with sixty_digits():
            place = [Decimal(x) for x in r]
            point_mass = potential_gradient(place, 0, tuple(Decimal(J) for J in alone))
            full = potential_gradient(place, n, tuple(Decimal(J) for J in alone))
            expected = np.array([a - b for a, b in zip(full, point_mass, strict=True)], dtype=float)
        both = [_gravity(field, degree, Difference(value=np.array(r), change=np.zeros(3))).value for degree in (n, 0)]
        found = np.asarray(both[0] - both[1])
        # The harmonic is a difference of gravities, which are 8 m/s^2 with sixteen digits.
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
    # Required is 1e-9; without cancellation all but the last two or three digits are right.
    assert relative_error(np.asarray(gravity(degree, r, d).change), expected) < 1e-12


@pytest.mark.parametrize("degree", [2, 6])
@given(SEEDS, st.floats(3.0, 6.0))
def test_gravity_and_its_change_sum_to_gravity_at_the_second_point(degree: int, seed: int, power: float) -> None:
    rng = np.random.default_rng(seed)
    r, d = random_position(rng), 10.0**power * random_unit(rng)
    here, there = gravity(degree, r, d), gravity(degree, r + d)
    assert relative_error(np.asarray(here.value + here.change), np.asarray(there.value)) < 1e-14


@pytest.mark.parametrize("degree", DEGREES)
@given(SEEDS)
def test_differential_gravity_is_zero_at_zero_distance(degree: int, seed: int) -> None:
    r = random_position(np.random.default_rng(seed))
    np.testing.assert_array_equal(gravity(degree, r).change, np.zeros(3))


def test_the_zonal_harmonics_are_those_of_egm96() -> None:
    # EGM-96, fully normalised coefficients C20 to C60, times -sqrt(2n + 1).
    normalised = [-0.484165371736e-3, 0.957254173792e-6, 0.539873863789e-6, 0.685323475630e-7, -0.149957994714e-6]
    published = [-np.sqrt(2 * n + 1) * c for n, c in enumerate(normalised, start=2)]
    np.testing.assert_allclose(EARTH_GRAVITY.zonals, published, rtol=1e-6)


@jax.jit
def propagate(r: jax.Array, v: jax.Array) -> tuple[jax.Array, jax.Array]:
    """State after 5400 s, about one orbit, in steps of 1 s."""
    none = jnp.zeros(3)

    def derivative(y: tuple[jax.Array, jax.Array], _: jax.Array) -> tuple[jax.Array, jax.Array]:
        return y[1], zonal_gravity.gravity(EARTH_GRAVITY, 2, Difference(value=y[0], change=none)).value

    def body(y: tuple[jax.Array, jax.Array], _: None) -> tuple[tuple[jax.Array, jax.Array], None]:
        return rk4(derivative, y, none, 1.0), None

    return jax.lax.scan(body, (r, v), None, length=5400)[0]


def test_an_orbit_with_J2_agrees_with_scipy_after_a_revolution() -> None:
    r, v = np.array([6.8e6, 1.0e5, -2.0e5]), np.array([100.0, 4000.0, 6500.0])
    found_r, found_v = propagate(r, v)
    solution = solve_ivp(
        lambda _, y: np.concatenate([y[3:], reference_gravity(y[:3])]), (0.0, 5400.0), np.concatenate([r, v]), "DOP853",
        rtol=1e-13, atol=1e-6,
    )  # fmt: skip
    expected = solution.y[:, -1]
    # Both integrators are accurate to about 1e-5 m; J2 moves the satellite by 30 km.
    np.testing.assert_allclose(found_r, expected[:3], atol=1e-4)
    np.testing.assert_allclose(found_v, expected[3:], atol=1e-7)
