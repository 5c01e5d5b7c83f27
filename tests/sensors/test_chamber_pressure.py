"""Chamber pressure statistics."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.sensors import chamber_pressure
from rpojax.sensors.chamber_pressure import ChamberPressure

SAMPLES = 10_000
FOUR_SIGMA = 4.0  # one false alarm in 16000, and the seeds are fixed

measure = jax.jit(jax.vmap(chamber_pressure.measure, in_axes=(None, None, 0)))


@pytest.mark.parametrize(("ratio", "noise"), [(1.0, 0.03), (0.6, 0.05), (0.0, 0.05), (0.8, 0.0)])
def test_the_thrust_ratio_has_the_relative_error_of_the_sensor(ratio: float, noise: float) -> None:
    normals = np.random.default_rng(6).normal(size=SAMPLES)
    found = np.asarray(measure(ChamberPressure(noise=jnp.asarray(noise)), np.float64(ratio), normals))
    sigma = noise * ratio
    assert abs(found.mean() - ratio) <= FOUR_SIGMA * sigma / np.sqrt(SAMPLES) + 1e-15
    np.testing.assert_allclose(found.std(), sigma, rtol=FOUR_SIGMA / np.sqrt(2 * SAMPLES), atol=1e-15)
