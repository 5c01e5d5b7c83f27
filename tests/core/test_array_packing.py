"""Packing of records into few arrays, and functions of packed records."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.core.array_packing import PackedFunction, PackedLayout, PackedRecord
from rpojax.core.pytree import pytree


@pytree
class Record:
    """Arrays of several kinds.

    Attributes:
        matrix: (2, 3)
        flag: () bool
        table: (70, 70)
        nothing: None
        rest: numbers of other kinds
    """

    matrix: Any
    flag: Any
    table: Any
    nothing: Any
    rest: tuple[Any, ...]


def record() -> Record:
    return Record(
        matrix=np.arange(6.0).reshape(2, 3),
        flag=np.array(True),
        table=np.ones((70, 70)),
        nothing=None,
        rest=(np.int32(7), np.zeros(0), np.array([1.5, 2.5]), np.array([3, 4], dtype=np.uint32)),
    )


def assert_same(found: Any, expected: Any) -> None:
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert np.asarray(a).dtype == np.asarray(b).dtype
        np.testing.assert_array_equal(a, b)


def test_unpacking_returns_the_packed_record() -> None:
    bundle = PackedRecord.of(record())
    assert len(bundle.arrays) == 5  # float64, bool, int32, uint32, and the large table on its own
    assert_same(bundle.to_numpy(), record())


def test_records_of_the_same_shapes_share_their_layout() -> None:
    assert PackedRecord.of(record()).layout is PackedLayout.of(record())


def test_a_packed_function_equals_the_function_and_is_compiled_once() -> None:
    traces = []

    def function(first: Record, second: tuple[Any, ...]) -> tuple[Any, ...]:
        traces.append(1)
        return {"sum": first.matrix + second[0], "table": 2.0 * first.table}, first.flag & (second[1] > 0)

    packed = PackedFunction(function)
    for number in (1.0, 2.0):
        order = (np.full((2, 3), number), np.int32(3))
        sums, flag = packed(PackedRecord.of(record()), PackedRecord.of(order))
        expected = function(jax.tree.map(jnp.asarray, record()), order)
        assert_same(sums.to_numpy(), jax.tree.map(np.asarray, expected[0]))
        assert flag.to_numpy() == np.asarray(expected[1])
    assert len(traces) == 3  # one to compile it, two for what is expected
