"""Lyapunov solution against scipy."""

import jax
import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from rpojax.flight.control import lyapunov

solve_lyapunov = jax.jit(lyapunov.solve_lyapunov)


def test_the_lyapunov_solution_agrees_with_scipy() -> None:
    rng = np.random.default_rng(1)
    F, S = 0.3 * rng.standard_normal((4, 4)), rng.standard_normal((4, 4))
    np.testing.assert_allclose(solve_lyapunov(F, S), solve_discrete_lyapunov(F.T, S), atol=1e-12)
