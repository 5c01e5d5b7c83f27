"""Riccati and Lyapunov solutions against scipy, and the derivative of the former against differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from rpojax.core.orbits.clohessy_wiltshire import transition_matrix
from rpojax.flight.control import riccati

RATE = np.float64(1.1e-3)  # mean motion at 500 km
RICCATI = 1e-9  # both solvers are good to the conditioning of the solution, 1e6, times rounding
solve_riccati = jax.jit(riccati.solve_riccati)
solve_lyapunov = jax.jit(riccati.solve_lyapunov)
Problem = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def relative_motion(period: float, weights: tuple[float, float, float]) -> Problem:
    A = np.asarray(transition_matrix(jnp.asarray(RATE), jnp.asarray(period)))
    position, velocity, delta_v = weights
    return A, A[:, 3:], np.diag([position] * 3 + [velocity] * 3), delta_v * np.eye(3)


def random_problem(seed: int, scale: float) -> Problem:
    rng = np.random.default_rng(seed)
    A = scale * rng.normal(size=(4, 4)) / 2.0
    factor = rng.normal(size=(4, 4))
    return A, rng.normal(size=(4, 2)), factor @ factor.T, np.diag(rng.uniform(0.1, 10.0, 2))


PROBLEMS = {
    "nominal": relative_motion(200.0, (1.0, 0.0, 3e4)),
    "cheap control": relative_motion(200.0, (1.0, 1e3, 1.0)),
    "dear control": relative_motion(200.0, (1.0, 0.0, 1e8)),
    "short period": relative_motion(20.0, (1.0, 1e2, 1e5)),
    "random, stable": random_problem(1, 0.5),
    "random, unstable": random_problem(2, 2.0),
}


@pytest.mark.parametrize("problem", PROBLEMS.values(), ids=PROBLEMS.keys())
def test_the_riccati_solution_agrees_with_scipy(problem: Problem) -> None:
    expected = solve_discrete_are(*problem)
    np.testing.assert_allclose(solve_riccati(*problem), expected, atol=RICCATI * np.max(np.abs(expected)))


RNG = np.random.default_rng(4)
A = np.eye(4) + 0.3 * RNG.standard_normal((4, 4))
B = RNG.standard_normal((4, 2))


def solution(x: jax.Array) -> jax.Array:
    weights = jnp.exp(0.1 * x[:6])
    change = 0.1 * x[6:].reshape(4, 4)
    return solve_riccati(A + change, B * (1.0 + x[0]), jnp.diag(weights[:4]), jnp.diag(weights[4:]))


def test_forward_and_reverse_derivatives_agree_with_differences() -> None:
    check_grads(jax.jit(solution), (np.zeros(22),), order=1, modes=["fwd", "rev"], atol=1e-6, rtol=1e-6)


def test_the_derivative_agrees_with_differences_of_scipys_solution() -> None:
    step = 1e-5
    Q, R, dQ = np.eye(4), np.eye(2), np.diag([1.0, 0.0, 2.0, 0.0])
    zero = np.zeros_like
    _, found = jax.jvp(solve_riccati, (A, B, Q, R), (zero(A), zero(B), dQ, zero(R)))
    up, down = (solve_discrete_are(A, B, Q + sign * step * dQ, R) for sign in (1.0, -1.0))
    np.testing.assert_allclose(found, (up - down) / (2.0 * step), rtol=1e-6, atol=1e-8)


def test_the_lyapunov_solution_agrees_with_scipy() -> None:
    rng = np.random.default_rng(1)
    F, S = 0.3 * rng.standard_normal((4, 4)), rng.standard_normal((4, 4))
    np.testing.assert_allclose(solve_lyapunov(F, S), solve_discrete_lyapunov(F.T, S), atol=1e-12)
