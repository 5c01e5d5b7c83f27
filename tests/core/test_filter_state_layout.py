"""Named blocks of a state vector: their places, and vectors and rows with some of them."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.filter_state_layout import MOTION, StateLayout

LAYOUT = StateLayout((*MOTION.blocks, ("size", 2), ("bias", 1)))


def test_blocks_lie_one_after_the_other() -> None:
    assert LAYOUT.size == 9
    assert (LAYOUT["velocity"], LAYOUT["bias"]) == (slice(3, 6), slice(8, 9))
    assert [*LAYOUT.places("size")] == [6, 7]
    assert LAYOUT.after("velocity") == StateLayout((("size", 2), ("bias", 1)))
    assert "size" in LAYOUT
    assert "time" not in LAYOUT
    with pytest.raises(KeyError):
        LAYOUT["time"]


def test_vectors_and_rows_are_zero_but_in_the_named_blocks() -> None:
    size = jnp.array([1.0, 2.0])
    np.testing.assert_array_equal(LAYOUT.vector(size=size), [0, 0, 0, 0, 0, 0, 1, 2, 0])
    rows = np.asarray(LAYOUT.rows(bias=jnp.array([[5.0], [6.0]]), position=jnp.ones((2, 3))))
    np.testing.assert_array_equal(rows, [[1, 1, 1, 0, 0, 0, 0, 0, 5], [1, 1, 1, 0, 0, 0, 0, 0, 6]])
    with pytest.raises(KeyError, match="found time, expected names of blocks: position, velocity, size, bias"):
        LAYOUT.vector(time=size)


def test_a_vector_is_the_sum_of_its_blocks() -> None:
    vector = jnp.arange(9.0)
    parts = LAYOUT.split(vector)
    assert [*parts] == ["position", "velocity", "size", "bias"]
    np.testing.assert_array_equal(LAYOUT.vector(**parts), vector)
