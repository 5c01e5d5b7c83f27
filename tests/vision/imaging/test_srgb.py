"""sRGB codes against worked values, in both precisions."""

import jax.numpy as jnp
import numpy as np

from rpojax.vision.imaging.srgb import linear_to_srgb, linear_to_srgb_numpy


def test_srgb_of_worked_values() -> None:
    linear = np.array([-1.0, 0.0, 0.002, 0.214041140482232, 1.0, 3.0])
    expected = [0.0, 0.0, 12.92 * 0.002, 0.5, 1.0, 1.0]
    np.testing.assert_allclose(linear_to_srgb_numpy(linear), expected, atol=1e-12)
    np.testing.assert_allclose(linear_to_srgb(jnp.asarray(linear, jnp.float32)), expected, atol=1e-6)
