"""Covariance of burn execution errors."""

import jax
import numpy as np
import pytest
from hypothesis import given
from numpy_reference import SEEDS, random_unit

from rpojax.flight.navigation import burn_execution_error

EXACT = 1e-13  # a few roundings relative to the standard deviations
burn = jax.jit(burn_execution_error.burn_covariance)


@given(SEEDS)
def test_the_steps_of_a_burn_sum_to_the_covariance_of_the_whole_burn(seed: int) -> None:
    rng = np.random.default_rng(seed)
    along = random_unit(rng)
    fractions = rng.uniform(0.1, 1.0, 9)
    size = 0.02
    delta_v = size * fractions[:, None] / fractions.sum() * along
    found = sum(np.asarray(burn(part, np.float64(size), np.float64(0.015), np.float64(0.005))) for part in delta_v)
    projection = np.outer(along, along)
    expected = size**2 * (0.015**2 * projection + 0.005**2 * (np.eye(3) - projection))
    np.testing.assert_allclose(found, expected, atol=EXACT * size**2)


@pytest.mark.parametrize("whole", [0.0, 0.02])
def test_a_step_without_thrust_adds_no_covariance(whole: float) -> None:
    found = burn(np.zeros(3), np.float64(whole), np.float64(0.015), np.float64(0.005))
    np.testing.assert_array_equal(found, np.zeros((3, 3)))
