"""Distributions of dispersed values drawn with random keys."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dispersed_samples import FIVE_SIGMA, LAST_DIGITS, RUNS

from rpojax.core import quaternion

NOMINAL_ATTITUDE = [0.5, -0.5, -0.5, -0.5]


def test_a_normal_has_the_nominal_mean_and_its_sigma_per_component(samples: dict[str, np.ndarray]) -> None:
    error = samples["initial.relative_position_m"] - np.array([0.0, -50.0, 0.0])
    assert np.all(np.abs(error[:, :2].mean(axis=0) / [1.0, 2.0]) < FIVE_SIGMA)
    np.testing.assert_allclose(error[:, :2].std(axis=0), [1.0, 2.0], rtol=FIVE_SIGMA)
    assert np.all(error[:, 2] == 0.0)
    assert abs(np.corrcoef(error[:, 0], error[:, 1])[0, 1]) < FIVE_SIGMA


def test_a_truncated_normal_has_its_limits_and_variance(
    samples: dict[str, np.ndarray],
) -> None:
    normalised = (samples["servicer.mass_kg"] - 30.0) / 2.0
    density = np.exp(-0.5 * 1.5**2) / np.sqrt(2.0 * np.pi)
    inside = 0.8663855974622838  # of a normal number within 1.5 sigma
    assert np.abs(normalised).max() <= 1.5
    assert np.abs(normalised).max() > 1.45
    assert abs(normalised.mean()) < FIVE_SIGMA
    np.testing.assert_allclose(normalised.var(), 1.0 - 2.0 * 1.5 * density / inside, rtol=2.0 * FIVE_SIGMA)


def test_a_uniform_has_a_uniform_distribution(samples: dict[str, np.ndarray]) -> None:
    quantile = np.sort((samples["orbit.true_anomaly_deg"] + 30.0) / 120.0)
    assert quantile[0] >= 0.0
    assert quantile[-1] < 1.0
    largest_gap = np.abs(quantile - np.arange(RUNS) / RUNS).max()
    assert largest_gap < 2.3 / np.sqrt(RUNS)  # Kolmogorov-Smirnov bound for a probability of 1e-4


def test_a_log_normal_has_the_nominal_median_and_its_sigma(samples: dict[str, np.ndarray]) -> None:
    logarithm = np.log(samples["gps.noise_m"] / 2.0) / 0.4
    assert abs(logarithm.mean()) < FIVE_SIGMA
    np.testing.assert_allclose(logarithm.std(), 1.0, rtol=FIVE_SIGMA)


def test_a_choice_takes_every_value_equally_often(samples: dict[str, np.ndarray]) -> None:
    values, counts = np.unique(samples["target.tumble_rate_deg_s"], return_counts=True)
    np.testing.assert_array_equal(values, [0.0, 1.0, 5.0])
    np.testing.assert_allclose(counts / RUNS, 1.0 / 3.0, atol=FIVE_SIGMA)


@pytest.mark.parametrize(("key", "size"), [("target.tumble_axis", 3), ("target.attitude", 4)])
def test_directions_and_attitudes_are_isotropic_unit_vectors(
    samples: dict[str, np.ndarray], key: str, size: int
) -> None:
    values = samples[key]
    np.testing.assert_allclose(np.linalg.norm(values, axis=1), 1.0, rtol=LAST_DIGITS)
    assert np.all(np.abs(values.mean(axis=0)) < FIVE_SIGMA)
    np.testing.assert_allclose(values.T @ values / RUNS, np.eye(size) / size, atol=FIVE_SIGMA)


def test_a_small_rotation_has_its_sigma_about_each_axis(samples: dict[str, np.ndarray]) -> None:
    conjugate = jnp.array(NOMINAL_ATTITUDE) * jnp.array([1.0, -1.0, -1.0, -1.0])
    turn = np.asarray(jax.vmap(lambda q: quaternion.multiply(q, conjugate))(jnp.asarray(samples["camera.mounting"])))
    angles = np.rad2deg(2.0 * turn[:, 1:] / turn[:, :1])
    assert np.all(np.abs(angles.mean(axis=0) / [1.0, 2.0, 3.0]) < FIVE_SIGMA)
    np.testing.assert_allclose(angles.std(axis=0), [1.0, 2.0, 3.0], rtol=2.0 * FIVE_SIGMA)
