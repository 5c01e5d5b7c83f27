"""Gyro statistics."""

import jax
import numpy as np

from rpojax.scenario.params import Params
from rpojax.sensors import gyro

RUNS = 4000
FOUR_SIGMA = 4.0  # one false alarm in 16000, and the seeds are fixed

measure = jax.jit(jax.vmap(gyro.measure, in_axes=(None, None, None, 0, None)), static_argnums=4)
advance_bias = jax.jit(jax.vmap(gyro.advance_bias, in_axes=(None, 0, 0, None)), static_argnums=3)
BOUND = FOUR_SIGMA / np.sqrt(2 * 3 * RUNS)


def test_the_integrated_angle_is_a_random_walk_for_any_sampling(params: Params) -> None:
    true, bias = np.array([0.01, -0.02, 0.03]), np.array([1e-4, 0.0, -1e-4])
    expected = np.deg2rad(0.0025) * np.sqrt(4.0)
    for samples, dt in ((20, 0.2), (4, 1.0)):
        normals = np.random.default_rng(samples).normal(size=(RUNS * samples, 3))
        rates = np.asarray(measure(params.gyro, true, bias, normals, dt)).reshape(RUNS, samples, 3)
        angle = dt * (rates - true - bias).sum(axis=1)
        np.testing.assert_allclose(angle.std(), expected, rtol=BOUND)
        assert np.all(np.abs(angle.mean(axis=0)) < FOUR_SIGMA * expected / np.sqrt(RUNS))


def test_the_bias_is_a_random_walk_from_its_initial_value(params: Params) -> None:
    rng = np.random.default_rng(3)
    start = np.array([1e-4, -1e-4, 0.0])
    bias = np.tile(start, (RUNS, 1))
    for _ in range(25):
        bias = advance_bias(params.gyro, bias, rng.normal(size=(RUNS, 3)), 4.0)
    grown = np.asarray(bias) - start
    np.testing.assert_allclose(grown.std(), np.deg2rad(1e-5) * np.sqrt(100.0), rtol=BOUND)
