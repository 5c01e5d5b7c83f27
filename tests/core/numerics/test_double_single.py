"""Double-single arithmetic against double precision."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rpojax.core.numerics import double_single
from rpojax.core.numerics.double_single import DoubleSingle
from rpojax.simulation import single_precision

add = jax.jit(double_single.add)
LARGE = st.floats(-1e7, 1e7, width=32, allow_subnormal=False)  # XLA flushes subnormal numbers to zero
SMALL = st.floats(-1e4, 1e4, width=32, allow_subnormal=False)


def exact(*parts: np.ndarray) -> np.ndarray:
    """Sum in double precision, which represents two float32 numbers of these magnitudes exactly."""
    return np.sum([part.astype(np.float64) for part in parts], axis=0)


@given(st.lists(LARGE, min_size=3, max_size=3), st.lists(SMALL, min_size=3, max_size=3))
def test_a_sum_is_exact_whichever_term_is_larger(total: list[float], part: list[float]) -> None:
    one, two, none = np.array(total, np.float32), np.array(part, np.float32), np.zeros(3, np.float32)
    for first, second in ((one, two), (two, one)):
        high, low = (np.asarray(each) for each in add(first, none, second))
        assert high.dtype == low.dtype == np.float32
        np.testing.assert_allclose(exact(high, low), exact(first, second), rtol=1e-13, atol=1e-13)
        np.testing.assert_array_equal(high, exact(first, second).astype(np.float32))


@given(st.lists(LARGE, min_size=3, max_size=3), st.lists(SMALL, min_size=3, max_size=3))
def test_a_product_has_twice_the_precision_of_float32(first: list[float], second: list[float]) -> None:
    one, two = np.array(first, np.float32), np.array(second, np.float32)
    kept = np.abs(one.astype(np.float64) * two) > 1e-20  # below, the split parts underflow
    found = jax.jit(double_single.two_product)(one, two)
    both = exact(np.asarray(found.high), np.asarray(found.low))
    np.testing.assert_allclose(both[kept], (one.astype(np.float64) * two)[kept], rtol=2.0**-44)


@given(st.floats(1e-3, 1e15), st.floats(-1e7, 1e7))
def test_products_and_inverse_square_roots_have_twice_the_precision_of_float32(square: float, other: float) -> None:
    @jax.jit
    def both(a: DoubleSingle, b: DoubleSingle) -> tuple[DoubleSingle, DoubleSingle]:
        return a * b, double_single.inverse_sqrt(a)

    with single_precision.tracing_in_single():
        a, b = double_single.from_float(square), double_single.from_float(other)
        times, root = ([np.asarray(part) for part in (each.high, each.low)] for each in both(a, b))
    np.testing.assert_allclose(exact(*times), square * other, rtol=2.0**-43, atol=1e-20)
    np.testing.assert_allclose(exact(*root), square**-0.5, rtol=2.0**-43)


def test_a_million_increments_below_the_last_digit_are_summed() -> None:
    start, part = np.full(3, 7e6, np.float32), np.array([1e-3, -1e-3, 0.3], np.float32)

    def step(carry: tuple[jax.Array, jax.Array], _: None) -> tuple[tuple[jax.Array, jax.Array], None]:
        return double_single.add(*carry, jnp.asarray(part)), None

    begin = (jnp.asarray(start), jnp.zeros(3, jnp.float32))
    (total, low), _ = jax.jit(lambda: jax.lax.scan(step, begin, None, length=1_000_000))()
    distance = exact(np.asarray(total), np.asarray(low)) - start.astype(np.float64)
    # The low-order part is at most half a unit in the last place, 0.25 m, and has its own rounding.
    np.testing.assert_allclose(distance, 1e6 * part.astype(np.float64), atol=1e6 * 0.5**26, rtol=0.0)
    assert np.all(np.asarray(start + part)[:2] == start[:2])


def test_the_difference_of_positions_includes_their_low_order_parts() -> None:
    r = np.array([7e6, 1.0, -2.0], np.float32)
    found = double_single.subtract(
        jnp.asarray(r), jnp.full(3, 0.125, jnp.float32), jnp.asarray(r), jnp.full(3, 0.25, jnp.float32)
    )
    np.testing.assert_array_equal(found, np.full(3, -0.125))
    np.testing.assert_array_equal(double_single.subtract(jnp.asarray(r), None, jnp.zeros(3, jnp.float32), None), r)
