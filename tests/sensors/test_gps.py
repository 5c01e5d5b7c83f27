"""GPS statistics."""

import jax
import numpy as np

from rpojax.scenario.params import Params
from rpojax.sensors import gps
from rpojax.sensors.gps import Gps

CHAINS, SAMPLES = 2000, 200
FOUR_SIGMA = 4.0  # one false alarm in 16000, and the seeds are fixed

measure = jax.jit(jax.vmap(gps.measure, in_axes=(None, None, None, 0)))


@jax.jit
def walk(sensor: Gps, start: jax.Array, normals: jax.Array) -> jax.Array:
    """Biases (samples, chains, 3) of many receivers, 10 s apart."""

    def body(bias: jax.Array, normals: jax.Array) -> tuple[jax.Array, jax.Array]:
        after = jax.vmap(lambda b, n: gps.advance_bias(sensor, b, n, 10.0))(bias, normals)
        return after, after

    return jax.lax.scan(body, start, normals)[1]


def test_positions_are_true_plus_bias_plus_white_noise(params: Params) -> None:
    true, bias = np.array([7.0e6, -1.0e6, 2.0e6]), np.array([1.0, -2.0, 0.5])
    normals = np.random.default_rng(1).normal(size=(10_000, 3))
    error = np.asarray(measure(params.gps, true, bias, normals)) - true - bias
    assert np.all(np.abs(error.mean(axis=0)) < FOUR_SIGMA * 2.0 / 100)
    np.testing.assert_allclose(error.std(axis=0), 2.0, rtol=FOUR_SIGMA / np.sqrt(2 * 10_000))
    correlation = np.corrcoef(error.T)[np.triu_indices(3, 1)]
    assert np.all(np.abs(correlation) < FOUR_SIGMA / 100)


def test_the_bias_is_stationary_with_its_time_constant(params: Params) -> None:
    rng = np.random.default_rng(2)
    start = 1.2 * rng.normal(size=(CHAINS, 3))
    biases = np.asarray(walk(params.gps, start, rng.normal(size=(SAMPLES, CHAINS, 3))))
    # Each chain is an independent draw: 6000 numbers at any one time.
    bound = FOUR_SIGMA / np.sqrt(2 * 3 * CHAINS)
    for time in (0, SAMPLES // 2, SAMPLES - 1):
        np.testing.assert_allclose(biases[time].std(), 1.2, rtol=bound)
    for lag in (7, 70, 140):
        correlation = np.corrcoef(biases[-1].ravel(), biases[-1 - lag].ravel())[0, 1]
        np.testing.assert_allclose(correlation, np.exp(-10.0 * lag / 700.0), atol=FOUR_SIGMA / np.sqrt(3 * CHAINS))
