"""The derivative of the Riccati solution against differences, also of another solver."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.test_util import check_grads
from scipy.linalg import solve_discrete_are

from rpojax.flight.control.formation_lqr import solve_riccati

RNG = np.random.default_rng(4)
A = np.eye(4) + 0.3 * RNG.standard_normal((4, 4))
B = RNG.standard_normal((4, 2))


def solution(x: jax.Array) -> jax.Array:
    weights = jnp.exp(0.1 * x[:6])
    change = 0.1 * x[6:].reshape(4, 4)
    return solve_riccati(A + change, B * (1.0 + x[0]), jnp.diag(weights[:4]), jnp.diag(weights[4:]))


def test_the_derivative_is_right_in_both_modes() -> None:
    check_grads(jax.jit(solution), (np.zeros(22),), order=1, modes=["fwd", "rev"], atol=1e-6, rtol=1e-6)


def test_the_derivative_is_that_of_another_solver() -> None:
    step = 1e-5
    Q, R, dQ = np.eye(4), np.eye(2), np.diag([1.0, 0.0, 2.0, 0.0])
    zero = np.zeros_like
    _, found = jax.jvp(solve_riccati, (A, B, Q, R), (zero(A), zero(B), dQ, zero(R)))
    up, down = (solve_discrete_are(A, B, Q + sign * step * dQ, R) for sign in (1.0, -1.0))
    np.testing.assert_allclose(found, (up - down) / (2.0 * step), rtol=1e-6, atol=1e-8)
