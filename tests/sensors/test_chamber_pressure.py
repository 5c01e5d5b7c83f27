"""Chamber pressure statistics."""

import jax
import numpy as np
import pytest

from rpojax.sensors import chamber_pressure

SAMPLES = 10_000
FOUR_SIGMA = 4.0  # one false alarm in 16000, and the seeds are fixed

measure = jax.jit(jax.vmap(chamber_pressure.measure, in_axes=(None, 0)))


@pytest.mark.parametrize("ratio", [1.0, 0.6, 0.0])
def test_the_thrust_ratio_has_an_error_of_three_per_cent(ratio: float) -> None:
    normals = np.random.default_rng(6).normal(size=SAMPLES)
    found = np.asarray(measure(np.float64(ratio), normals))
    sigma = 0.03 * ratio
    assert abs(found.mean() - ratio) <= FOUR_SIGMA * sigma / np.sqrt(SAMPLES)
    np.testing.assert_allclose(found.std(), sigma, rtol=FOUR_SIGMA / np.sqrt(2 * SAMPLES), atol=0.0)
