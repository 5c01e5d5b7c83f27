"""Equal operations are evaluated once, similar ones are not merged."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.batching import jax_programs, vmap_last_axis
from rpojax.batching.batched_value import BatchedValue
from rpojax.batching.equal_operations import EqualOperations

BATCH_SIZE = 7
X = np.random.default_rng(1).normal(size=(3, BATCH_SIZE))
M = np.random.default_rng(2).normal(size=(3, 3, BATCH_SIZE))
S = np.random.default_rng(3).normal(size=BATCH_SIZE)


def operations(function: Any, *arguments: Any) -> list[jax_programs.Operation]:
    """Operations of a function."""
    return jax_programs.pure_program(jax.make_jaxpr(function)(*arguments)).operations


def evaluations(pairs: Any) -> int:
    """How many of some operations with their operands are evaluated."""
    equal, count = EqualOperations(), 0

    def evaluate() -> list[BatchedValue]:
        nonlocal count
        count += 1
        return [BatchedValue(jnp.zeros(3), True)]

    for operation, operands in pairs:
        assert len(equal.evaluate_once(operation, operands, evaluate)) == 1
    return count


def test_an_operation_is_evaluated_once_on_the_same_operands() -> None:
    sine, again, cosine = operations(lambda x: (jnp.sin(x), jnp.sin(x), jnp.cos(x)), X[:, 0])
    x, y = BatchedValue(jnp.asarray(X), True), BatchedValue(jnp.asarray(X), True)
    assert evaluations([(sine, [x]), (again, [x]), (sine, [x])]) == 1
    assert evaluations([(sine, [x]), (cosine, [x])]) == 2
    assert evaluations([(sine, [x]), (sine, [y])]) == 2  # another array, though its numbers are equal
    assert evaluations([(sine, [x]), (sine, [BatchedValue(x.array, False)])]) == 2


def test_constants_are_compared_by_their_bits() -> None:
    (sine,) = operations(jnp.sin, 1.0)
    values = [np.float64(0.0), np.float64(-0.0), np.float32(0.0), np.int64(0), np.zeros(1), np.float64(0.0)]
    assert evaluations([(sine, [BatchedValue(np.asarray(value), False)]) for value in values]) == 5


def test_parameters_are_compared() -> None:
    rows = operations(lambda m: (jnp.sum(m, axis=0), jnp.sum(m, axis=1), jnp.sum(m, axis=0)), M[..., 0])
    m = BatchedValue(jnp.asarray(M), True)
    assert evaluations([(row, [m]) for row in rows]) == 2


def test_an_operation_with_functions_in_it_is_evaluated_every_time() -> None:
    kind = jax.ShapeDtypeStruct((3,), float)
    (asked,) = operations(lambda x: jax.pure_callback(np.sin, kind, x), X[:, 0])
    x = BatchedValue(jnp.asarray(X), True)
    assert evaluations([(asked, [x]), (asked, [x])]) == 2


def test_repeated_operations_are_evaluated_once() -> None:
    """Also across functions and the branches of a conditional, but not between a loop and its surroundings."""
    again = jax.jit(lambda x: jnp.sin(x * 2.0) * 3.0)

    def function(x: Any, m: Any, s: Any) -> Any:
        def body(carry: Any, row: Any) -> Any:
            return carry + row * jnp.sin(s * 2.0), None

        chosen = jax.lax.cond(s > 0.0, lambda: jnp.sin(x * 2.0), lambda: -jnp.sin(x * 2.0))
        return (
            again(x) + again(x) + chosen,
            jax.lax.scan(body, jnp.sin(s * 2.0), m[0])[0] + jnp.sin(s * 2.0),
            s[None] * 7.0,
        )

    every = vmap_last_axis.vmap(function, (-1, -1, -1), -1)
    traced = str(jax.make_jaxpr(every)(X, M, S))
    assert traced.count(" sin ") == 3  # of x, of s, and of s in the loop
    for found, expected in zip(every(X, M, S), jax.vmap(function, -1, -1)(X, M, S), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-14)


def similar_operations(x: Any, m: Any) -> Any:
    """Operations that differ only in the sign of zero, the type of zero, the position or the width."""
    signs = x / 0.0, x / -0.0
    kinds = x > 0.0, jnp.round(x).astype(int) > 0, jnp.zeros(3) + x, jnp.zeros(3, dtype=int) + jnp.round(x).astype(int)
    widths = [jax.lax.bitcast_convert_type(x, kind) for kind in (jnp.uint64, jnp.uint32)]
    return signs, kinds, (x[0:2], x[1:3], m[0], m[:, 0]), widths


def test_similar_operations_are_not_merged() -> None:
    every = vmap_last_axis.vmap(similar_operations, (-1, -1), -1)
    expected = jax.vmap(similar_operations, (-1, -1), -1)(jnp.abs(X), M)
    for found, wanted in zip(jax.tree.leaves(every(jnp.abs(X), M)), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_the_same_array_batched_and_shared_is_not_merged() -> None:
    square = jnp.asarray(X[:, :3])
    many, common = vmap_last_axis.vmap(lambda a, b: (jnp.sin(a), jnp.sin(b)), (-1, None), (-1, None))(square, square)
    np.testing.assert_array_equal(many, common)
    summed, _ = vmap_last_axis.vmap(lambda a, b: (jnp.sin(a)[0], jnp.sin(b)), (-1, None), (-1, None))(square, square)
    np.testing.assert_array_equal(summed, jnp.sin(square)[0])
