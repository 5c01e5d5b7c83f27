"""Sunlight and the gravity-gradient torque."""

import jax
import numpy as np
import pytest
from hypothesis import given
from reference import MU, RADIUS, SEEDS, random_unit, relative_error

from rpojax.physics import environment

SUN = np.array([1.0, 0.0, 0.0])

gravity_gradient_torque = jax.jit(environment.gravity_gradient_torque)
is_lit = jax.jit(environment.is_lit)


@pytest.mark.parametrize(
    ("position", "lit"),
    [
        ([7.0e6, 0.0, 0.0], True),
        ([-7.0e6, 0.0, 0.0], False),
        ([0.0, 7.0e6, 0.0], True),
        ([-1.0, 0.0, -7.0e6], True),
        ([-2.0e6, RADIUS - 1.0e3, 0.0], False),
        ([-2.0e6, RADIUS + 1.0e3, 0.0], True),
    ],
    ids=["noon", "midnight", "terminator", "just past the terminator", "inside the shadow's edge", "outside of it"],
)
def test_the_shadow_is_a_cylinder_behind_the_earth(position: list[float], lit: bool) -> None:
    assert bool(is_lit(np.array(position), SUN)) is lit


@given(SEEDS)
def test_the_gravity_gradient_torque_is_that_of_gravity_on_the_bodys_parts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    r = (7.0e6 * random_unit(rng)).astype(np.longdouble)
    masses = np.repeat(rng.uniform(1.0, 20.0, 3), 2)
    half = rng.normal(size=(3, 3))
    places = np.concatenate([half, -half])[[0, 3, 1, 4, 2, 5]]  # pairs about the centre of mass
    inertia = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, places, strict=True))
    torque = np.zeros(3, dtype=np.longdouble)
    for m, p in zip(masses, places, strict=True):
        at = r + p
        pull = -np.longdouble(MU) * m * at / np.sqrt(np.sum(at * at)) ** 3
        torque = torque + np.cross(p, pull)
    found = np.asarray(gravity_gradient_torque(r.astype(float), inertia))
    # The formula is the first order in size over distance, 2e-7; in pairs the second order cancels as well.
    assert relative_error(found, torque.astype(float)) < 1e-6


def test_a_body_with_a_principal_axis_along_the_vertical_feels_no_torque() -> None:
    found = gravity_gradient_torque(np.array([0.0, 7.0e6, 0.0]), np.diag([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(found, np.zeros(3))
