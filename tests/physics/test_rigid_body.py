"""Rotation of bodies with and without wheels, against independent formulations."""

import jax
import numpy as np
from hypothesis import given
from numpy_reference import SEEDS, random_unit

from rpojax.physics import rigid_body

TEXTBOOK = 1e-11  # rounding times the conditioning of random inertias

accelerations_with_wheels = jax.jit(rigid_body.accelerations_with_wheels)
angular_acceleration = jax.jit(rigid_body.angular_acceleration)
inverse = jax.jit(rigid_body.inverse_3x3)
inverse_without_wheels = jax.jit(rigid_body.inverse_hub_inertia)
wheel_momentum = jax.jit(rigid_body.wheel_momentum)


def random_inertia(rng: np.random.Generator) -> np.ndarray:
    factor = rng.normal(size=(3, 6))
    return factor @ factor.T


def random_axes(rng: np.random.Generator) -> np.ndarray:
    """Three linearly independent unit axes in no special directions."""
    axes = np.eye(3) + 0.4 * rng.uniform(-1.0, 1.0, (3, 3))
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


@given(SEEDS)
def test_the_inverse_of_a_matrix_times_the_matrix_is_the_identity(seed: int) -> None:
    matrix = random_inertia(np.random.default_rng(seed))
    np.testing.assert_allclose(inverse(matrix), np.linalg.inv(matrix), rtol=1e-8, atol=1e-12)


def test_angular_acceleration_agrees_with_eulers_equation_worked_by_hand() -> None:
    inertia = np.diag([1.0, 2.0, 3.0])
    found = angular_acceleration(inertia, inverse(inertia), np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, 3.0]))
    # (I2 - I3) w2 w3 / I1, (I3 - I1) w3 w1 / I2, ((I1 - I2) w1 w2 + 3) / I3
    np.testing.assert_allclose(found, [-0.06, 0.03, 1.0 - 0.02 / 3.0], rtol=1e-14)


@given(SEEDS)
def test_body_and_wheel_accelerations_solve_the_coupled_momentum_equations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axes = random_axes(rng)
    wheel_inertia = rng.uniform(0.001, 0.05, 3)
    inertia = random_inertia(rng) + 0.2 * np.eye(3)
    omega, speed = 0.5 * random_unit(rng), rng.uniform(-300.0, 300.0, 3)
    motor, external = 0.02 * rng.normal(size=3), 0.01 * rng.normal(size=3)
    # One 6 by 6 system: Newton for the whole, and each motor against its own wheel's inertial acceleration.
    momentum = inertia @ omega + axes.T @ (wheel_inertia * speed)
    whole = np.concatenate([inertia, axes.T * wheel_inertia], axis=1)
    wheels = np.concatenate([wheel_inertia[:, None] * axes, np.diag(wheel_inertia)], axis=1)
    right = np.concatenate([external - np.cross(omega, momentum), motor])
    expected = np.linalg.solve(np.concatenate([whole, wheels]), right)
    hub = inverse_without_wheels(inertia, axes, wheel_inertia)
    found = accelerations_with_wheels(inertia, hub, axes, wheel_inertia, omega, speed, motor, external)
    np.testing.assert_allclose(found[0], expected[:3], atol=TEXTBOOK * np.max(np.abs(expected)))
    np.testing.assert_allclose(found[1], expected[3:], atol=TEXTBOOK * np.max(np.abs(expected)))


def test_wheel_momentum_lies_along_the_spin_axes() -> None:
    axes = np.array([[0.0, 1.0, 0.0], [0.6, 0.0, 0.8], [1.0, 0.0, 0.0]])
    found = wheel_momentum(axes, np.array([0.1, 0.2, 0.3]), np.array([1.0, 10.0, -1.0]))
    np.testing.assert_allclose(found, [1.2 - 0.3, 0.1, 1.6], rtol=1e-14)
