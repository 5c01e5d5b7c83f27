"""Small positive definite systems against NumPy, side by side and alone."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.numerics.small_systems import inverse_positive_definite, solve_positive_definite


@pytest.mark.parametrize("size", [1, 3, 6])
@pytest.mark.parametrize("systems", [(), (4,), (2, 3)])
def test_solutions_and_inverses_are_those_of_numpy(size: int, systems: tuple[int, ...]) -> None:
    rng = np.random.default_rng(size)
    roots = rng.normal(size=(*systems, size, size))
    matrices = roots @ np.swapaxes(roots, -1, -2) + 0.1 * np.eye(size)
    right = rng.normal(size=(*systems, size))
    to_front = jnp.asarray(np.moveaxis(matrices, (-2, -1), (0, 1))), jnp.asarray(np.moveaxis(right, -1, 0))
    solution = np.moveaxis(np.asarray(solve_positive_definite(*to_front)), 0, -1)
    inverse = np.moveaxis(np.asarray(inverse_positive_definite(to_front[0])), (0, 1), (-2, -1))
    np.testing.assert_allclose(solution, np.linalg.solve(matrices, right[..., None])[..., 0], rtol=1e-9)
    np.testing.assert_allclose(inverse, np.linalg.inv(matrices), rtol=1e-9, atol=1e-12)


def test_what_a_singular_system_leaves_open_is_zero() -> None:
    matrix = jnp.diag(jnp.array([4.0, 0.0, 2.0]))
    np.testing.assert_allclose(solve_positive_definite(matrix, jnp.ones(3)), [0.25, 0.0, 0.5], rtol=1e-15)
    np.testing.assert_allclose(inverse_positive_definite(matrix), np.diag([0.25, 0.0, 0.5]), rtol=1e-15)
