"""Tests of the allocation of force and torque to thrusters, against solvers of SciPy."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linprog, lsq_linear

from rpojax.flight.control import thruster_allocation
from rpojax.flight.control.thruster_allocation import ThrusterLayout

THRUSTERS = 12
_each = jax.jit(jax.vmap(thruster_allocation.allocate, in_axes=(None, 0, None, None)), static_argnums=3)


def random_layout(rng: np.random.Generator) -> ThrusterLayout:
    """Thrusters of different size at random places of a body of one metre."""
    position = rng.uniform(-0.5, 0.5, (THRUSTERS, 3))
    direction = rng.normal(size=(THRUSTERS, 3))
    force = rng.uniform(0.5, 1.5, THRUSTERS)
    wrench = thruster_allocation.wrench_matrix(force, direction, position)
    return thruster_allocation.layout(wrench, force, np.zeros(THRUSTERS))


def scaled(thrusters: ThrusterLayout, wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrix and right side in units of one thruster's force and torque."""
    scale = np.array(thrusters.scale)
    return np.array(thrusters.wrench) / scale[:, None], wrench / scale


@pytest.mark.parametrize("seed", range(6))
def test_feasible_commands_are_met_with_the_least_propellant(seed: int) -> None:
    rng = np.random.default_rng(seed)
    thrusters = random_layout(rng)
    given = rng.uniform(0.0, 1.0, (8, THRUSTERS)) * (rng.uniform(size=(8, THRUSTERS)) < 0.4)
    wrenches = given @ np.array(thrusters.wrench).T
    shares = np.array(_each(thrusters, jnp.asarray(wrenches), jnp.ones(THRUSTERS), 15))
    assert np.all((shares >= 0.0) & (shares <= 1.0))
    for share, wrench in zip(shares, wrenches, strict=True):
        A, b = scaled(thrusters, wrench)
        assert np.linalg.norm(A @ share - b) < 1e-3
        cost = np.array(thrusters.cost)
        least = linprog(cost, A_eq=A, b_eq=b, bounds=(0.0, 1.0)).fun
        assert cost @ share <= 1.05 * least + 1e-3


@pytest.mark.parametrize("seed", range(6))
def test_commands_beyond_the_bounds_leave_the_least_residual(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    thrusters = random_layout(rng)
    wrenches = 6.0 * rng.normal(size=(8, 6)) * np.array(thrusters.scale)
    shares = np.array(_each(thrusters, jnp.asarray(wrenches), jnp.ones(THRUSTERS), 15))
    for share, wrench in zip(shares, wrenches, strict=True):
        A, b = scaled(thrusters, wrench)
        best = np.linalg.norm(A @ lsq_linear(A, b, (0.0, 1.0), tol=1e-14).x - b)
        assert np.linalg.norm(A @ share - b) <= 1.01 * best


def test_many_steps_agree_with_the_exact_minimum() -> None:
    rng = np.random.default_rng(7)
    thrusters = random_layout(rng)
    wrenches = 3.0 * rng.normal(size=(16, 6)) * np.array(thrusters.scale)
    shares = np.array(_each(thrusters, jnp.asarray(wrenches), jnp.ones(THRUSTERS), 60))
    for share, wrench in zip(shares, wrenches, strict=True):
        A, b = scaled(thrusters, wrench)
        gradient = A.T @ (A @ share - b) + thruster_allocation.PROPELLANT_WEIGHT * np.array(thrusters.cost)
        # Optimality: no share inside its bounds has a slope, and none at a bound wants to leave it.
        inside = (share > 1e-6) & (share < 1.0 - 1e-6)
        assert np.abs(gradient[inside]).max(initial=0.0) < 1e-6
        assert np.all(gradient[share <= 1e-6] > -1e-6)
        assert np.all(gradient[share >= 1.0 - 1e-6] < 1e-6)


def test_a_thruster_that_is_shut_off_is_not_used() -> None:
    thrusters = random_layout(np.random.default_rng(3))
    works = jnp.ones(THRUSTERS).at[4].set(0.0)
    wrench = jnp.asarray(np.array(thrusters.wrench)[:, 4])
    shares = thruster_allocation.allocate(thrusters, wrench, works)
    assert shares[4] == 0.0
    assert float(jnp.max(shares)) > 0.1


def test_derivative_agrees_with_differences() -> None:
    thrusters = random_layout(np.random.default_rng(11))
    wrench = jnp.asarray(np.array(thrusters.wrench) @ np.full(THRUSTERS, 0.3))
    made = functools.partial(thruster_allocation.allocate, thrusters, works=jnp.ones(THRUSTERS), steps=40)

    def first_axis(change: jax.Array) -> jax.Array:
        return (thrusters.wrench @ made(wrench + change * jnp.eye(6)[0]))[0]

    assert abs(float(jax.grad(first_axis)(0.0)) - 1.0) < 1e-3


def test_authority_of_six_opposed_pairs() -> None:
    # Two thrusters push each way along each axis, at 0.5 m to both sides of the next axis.
    direction, position = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            for side in (0.5, -0.5):
                direction.append(sign * np.eye(3)[axis])
                position.append(side * np.eye(3)[(axis + 1) % 3])
    wrench = thruster_allocation.wrench_matrix(np.full(12, 2.0), np.array(direction), np.array(position))
    authority = thruster_allocation.axis_authority(wrench)
    assert np.allclose(authority[:, :3], 4.0)
    assert np.allclose(authority[:, 3:], 2.0)
