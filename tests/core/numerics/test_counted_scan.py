"""A scan over a number of passes that is known only when it runs, against `lax.scan` of that number."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.numerics.counted_scan import scan_to_count

MOST = 30
Carry = tuple[jax.Array, jax.Array]
Row = dict[str, jax.Array]


def body(carry: Carry) -> tuple[Carry, Row]:
    """Logistic map and a counter."""
    x, number = carry
    after = 3.7 * x * (1.0 - x)
    return (after, number + 1), {"sum": jnp.sum(after, axis=0), "is_even": number % 2 == 0}


@pytest.fixture(scope="module")
def begin() -> Carry:
    return jnp.array([0.2, 0.4]), jnp.int32(0)


def test_one_program_makes_any_number_of_passes(begin: Carry) -> None:
    program = jax.jit(lambda carry, count: scan_to_count(body, carry, count, MOST)).lower(begin, jnp.int32(0)).compile()
    for count in (10, 30):
        after, rows = program(begin, jnp.int32(count))
        expected, stacked = jax.jit(lambda carry, n=count: jax.lax.scan(lambda c, _: body(c), carry, None, n))(begin)
        np.testing.assert_array_equal(after[0], expected[0])
        assert int(after[1]) == count
        for name, values in rows.items():
            assert values.shape == (MOST,)
            assert values.dtype == stacked[name].dtype
            np.testing.assert_array_equal(values[:count], stacked[name])
            assert not np.any(values[count:])


def test_a_number_of_passes_is_rounded_up_to_whole_tens(begin: Carry) -> None:
    numbers = [int(scan_to_count(body, begin, jnp.int32(count), MOST)[0][1]) for count in (0, 1, 10, 11, 30)]
    assert numbers == [0, 10, 10, 20, 30]
