"""Third-body gravity against differences in sixty digits, and against published magnitudes."""

from collections.abc import Callable
from decimal import Decimal

import jax
import numpy as np
import pytest
from high_precision_gravity import DecimalVector, field_difference, sixty_digits
from hypothesis import given
from hypothesis import strategies as st
from numpy_reference import SEEDS, random_unit, relative_error

from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.orbits import third_body_gravity

BODIES = {"sun": (1.32712440018e20, 1.496e11), "moon": (4.9028e12, 3.84e8)}
"""Gravitational parameter [m^3/s^2] and distance [m]."""

third_body_acceleration = jax.jit(third_body_gravity.third_body_acceleration, static_argnums=0)


def perturbation(mu: float, body: np.ndarray) -> Callable[[DecimalVector], DecimalVector]:
    """Textbook formula: acceleration at a position less that of the Earth, in sixty digits."""
    centre = [Decimal(float(x)) for x in body]

    def pull(place: DecimalVector) -> DecimalVector:
        away = [b - x for b, x in zip(centre, place, strict=True)]
        distance, far = (sum(x * x for x in vector).sqrt() for vector in (away, centre))
        return [Decimal(mu) * (x / distance**3 - b / far**3) for x, b in zip(away, centre, strict=True)]

    return pull


@pytest.mark.parametrize("body", BODIES)
@given(SEEDS, st.floats(-3.0, 6.0))
def test_third_body_acceleration_and_its_difference_between_spacecraft_do_not_cancel(
    body: str, seed: int, power: float
) -> None:
    rng = np.random.default_rng(seed)
    mu, distance = BODIES[body]
    place, r = distance * random_unit(rng), rng.uniform(6.6e6, 4.2e7) * random_unit(rng)
    d = 10.0**power * random_unit(rng)
    field = perturbation(mu, place)
    found = third_body_acceleration(mu, place, Difference(value=r, change=d))
    with sixty_digits():
        absolute = np.array([float(x) for x in field([Decimal(float(x)) for x in r])])
    # Required is 1e-9. The distance to the body is rounded to 1e-16 of itself.
    assert relative_error(np.asarray(found.value), absolute) < 1e-12
    assert relative_error(np.asarray(found.change), field_difference(field, r, d)) < 1e-12


@pytest.mark.parametrize(("body", "expected"), [("moon", 1.22e-6), ("sun", 5.57e-7)])
def test_towards_the_body_the_acceleration_is_the_published_tide(body: str, expected: float) -> None:
    # 2 mu r / d^3 at 7000 km: 1.21e-6 m/s^2 by the Moon, 5.5e-7 by the Sun; higher orders add 3 % for the Moon.
    mu, distance = BODIES[body]
    towards = np.array([0.0, distance, 0.0])
    found = third_body_acceleration(
        mu, towards, Difference(value=np.array([0.0, 7.0e6, 0.0]), change=np.zeros(3))
    ).value
    np.testing.assert_allclose(found[1], 2.0 * mu * 7.0e6 / distance**3, rtol=0.03)
    np.testing.assert_allclose(found[1], expected, rtol=0.03)
    assert found[1] > 0.0


def test_the_acceleration_is_zero_at_the_centre_of_the_earth_and_its_difference_zero_at_zero_distance() -> None:
    found = third_body_acceleration(
        4.9e12, np.array([3.84e8, 0.0, 0.0]), Difference(value=np.zeros(3), change=np.zeros(3))
    )
    np.testing.assert_array_equal(found.value, np.zeros(3))
    np.testing.assert_array_equal(found.change, np.zeros(3))
