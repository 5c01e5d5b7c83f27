"""Power series of cosine, sine and arc tangent against numpy."""

import jax
import numpy as np

from rpojax.core.numerics.trigonometric_series import arctan2, cos_sin, cos_sinc


def test_cosine_and_sinc_are_accurate_to_rounding_up_to_half_a_turn() -> None:
    x = np.concatenate([np.logspace(-9, np.log10(np.pi), 200), [np.pi / 2]])
    cosine, sinc = jax.jit(cos_sinc)(x * x)
    np.testing.assert_allclose(cosine, np.cos(x), atol=2e-15)
    np.testing.assert_allclose(sinc, np.sin(x) / x, atol=2e-15)


def test_cosine_and_sinc_are_one_at_zero_with_the_right_derivatives() -> None:
    value, slope = jax.jvp(cos_sinc, (np.float64(0.0),), (np.float64(1.0),))
    np.testing.assert_array_equal(value, [1.0, 1.0])
    np.testing.assert_allclose(slope, [-1.0 / 2.0, -1.0 / 6.0], rtol=1e-15)


def test_cosine_and_sine_of_many_turns_are_accurate_to_the_rounding_of_the_angle() -> None:
    x = np.linspace(-700.0, 700.0, 5001)
    cosine, sine = jax.jit(cos_sin)(x)
    np.testing.assert_allclose(cosine, np.cos(x), atol=1e-13)
    np.testing.assert_allclose(sine, np.sin(x), atol=1e-13)
    slopes = jax.vmap(jax.jacfwd(cos_sin))(x)
    np.testing.assert_allclose(slopes, [-np.sin(x), np.cos(x)], atol=1e-13)


def test_the_arc_tangent_is_accurate_to_two_roundings_from_1e_minus_150_to_1e150() -> None:
    rng = np.random.default_rng(0)
    sizes = 10.0 ** rng.uniform(-150, 150, (2, 20_000))
    near = 10.0 ** rng.uniform(-1, 1, (2, 20_000))
    axes = np.array([[0.0, 0.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0], [1.0, -1.0, 0.0, 0.0, 1.0, -1.0, 1.0, -1.0]])
    points = np.concatenate([sizes, near], axis=1) * rng.choice([-1.0, 1.0], (2, 40_000))
    y, x = np.concatenate([points, axes], axis=1)
    np.testing.assert_allclose(jax.jit(arctan2)(y, x), np.arctan2(y, x), rtol=4.5e-16, atol=0.0)


def test_the_arc_tangent_has_the_derivatives_of_numpy_and_zero_at_the_origin() -> None:
    y, x = np.random.default_rng(1).normal(size=(2, 1000))
    slopes = jax.jit(jax.vmap(jax.grad(arctan2, argnums=(0, 1))))
    np.testing.assert_allclose(slopes(y, x), [x / (x * x + y * y), -y / (x * x + y * y)], rtol=1e-14)
    np.testing.assert_array_equal(slopes(*np.zeros((2, 1))), np.zeros((2, 1)))


def test_the_arc_tangent_of_the_origin_is_zero_whatever_the_signs_of_its_zeros() -> None:
    zeros = np.array([[0.0, 0.0], [0.0, -0.0], [-0.0, 0.0], [-0.0, -0.0]]).T
    np.testing.assert_array_equal(jax.jit(arctan2)(*zeros), np.zeros(4))


def test_the_arc_tangent_of_nan_and_its_derivatives_are_nan() -> None:
    y, x = np.array([np.nan, 1.0]), np.array([1.0, np.nan])
    assert np.all(np.isnan(jax.jit(arctan2)(y, x)))
    assert np.all(np.isnan(jax.vmap(jax.grad(arctan2, argnums=(0, 1)))(y, x)))
