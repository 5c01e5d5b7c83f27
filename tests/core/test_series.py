"""The power series of cosine and sine against the library's."""

import jax
import numpy as np

from rpojax.core.series import cos_sinc


def test_cosine_and_sinc_are_right_to_rounding_up_to_half_a_turn() -> None:
    x = np.concatenate([np.logspace(-9, np.log10(np.pi), 200), [np.pi / 2]])
    cosine, sinc = jax.jit(cos_sinc)(x * x)
    np.testing.assert_allclose(cosine, np.cos(x), atol=2e-15)
    np.testing.assert_allclose(sinc, np.sin(x) / x, atol=2e-15)


def test_cosine_and_sinc_are_one_at_zero_and_have_their_slopes_there() -> None:
    value, slope = jax.jvp(cos_sinc, (np.float64(0.0),), (np.float64(1.0),))
    np.testing.assert_array_equal(value, [1.0, 1.0])
    np.testing.assert_allclose(slope, [-1.0 / 2.0, -1.0 / 6.0], rtol=1e-15)
