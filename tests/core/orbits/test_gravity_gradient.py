"""The gravity gradient against central differences of two-body gravity."""

import jax
import numpy as np
from hypothesis import given
from numpy_reference import MU, SEEDS, random_position, relative_error

from rpojax.core.orbits import gravity_gradient

gradient_at = jax.jit(gravity_gradient.gravity_gradient)


@given(SEEDS)
def test_the_gravity_gradient_is_the_derivative_of_two_body_gravity(seed: int) -> None:
    r, h = random_position(np.random.default_rng(seed)), 10.0

    def two_body(x: np.ndarray) -> np.ndarray:
        return -MU * x / np.linalg.norm(x) ** 3

    columns = [(two_body(r + h * e) - two_body(r - h * e)) / (2 * h) for e in np.eye(3)]
    # Central difference: rounding 1e-16 r / h = 1e-10.
    assert relative_error(np.asarray(gradient_at(r)), np.stack(columns, axis=1)) < 1e-8
