"""Gravity-gradient torque against the gravity of a body's parts."""

import jax
import numpy as np
from hypothesis import given
from numpy_reference import MU, SEEDS, random_unit, relative_error

from rpojax.physics.environment.gravity_gradient_torque import gravity_gradient_torque

compiled_torque = jax.jit(gravity_gradient_torque)


@given(SEEDS)
def test_the_gravity_gradient_torque_agrees_with_point_masses(seed: int) -> None:
    rng = np.random.default_rng(seed)
    r = (7.0e6 * random_unit(rng)).astype(np.longdouble)
    masses = np.repeat(rng.uniform(1.0, 20.0, 3), 2)
    half = rng.normal(size=(3, 3))
    places = np.concatenate([half, -half])[[0, 3, 1, 4, 2, 5]]  # pairs about the centre of mass
    inertia = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, places, strict=True))
    torque = np.zeros(3, dtype=np.longdouble)
    for m, p in zip(masses, places, strict=True):
        at = r + p
        force = -np.longdouble(MU) * m * at / np.sqrt(np.sum(at * at)) ** 3
        torque = torque + np.cross(p, force)
    found = np.asarray(compiled_torque(r.astype(float), inertia))
    # The formula is the first order in size over distance, 2e-7; in pairs the second order cancels as well.
    assert relative_error(found, torque.astype(float)) < 1e-6


def test_there_is_no_torque_on_a_body_with_a_vertical_principal_axis() -> None:
    found = compiled_torque(np.array([0.0, 7.0e6, 0.0]), np.diag([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(found, np.zeros(3))
