"""Ranges over the links of a team."""

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.sensors import link_range
from rpojax.sensors.link_range import LinkRange

ERRORS = LinkRange(noise=jnp.asarray(0.1), bias_sigma=jnp.asarray(0.5))


def test_ranges_are_distances_with_a_bias_for_each_pair_and_noise() -> None:
    places = jnp.array([[0.0, 3.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 12.0]])
    normals = np.random.default_rng(0).normal(size=(2, 500, 3, 3))
    biases = jax.vmap(lambda z: link_range.bias(ERRORS, z))(jnp.asarray(normals[0]))
    np.testing.assert_array_equal(biases, np.swapaxes(biases, 1, 2))
    found = jax.vmap(lambda b, z: link_range.measure(ERRORS, places, b, z))(biases, jnp.asarray(normals[1]))
    expected = np.array([[0.0, 5.0, 12.0], [5.0, 0.0, 13.0], [12.0, 13.0, 0.0]])
    np.testing.assert_allclose((found - biases).mean(axis=0), expected, atol=0.02)
    np.testing.assert_allclose(np.std(found - biases, axis=0), 0.1, atol=0.01)
    # Five hundred draws know a sigma to 3 %.
    np.testing.assert_allclose(np.std(biases, axis=0)[0, 1:], 0.5, atol=0.05)
