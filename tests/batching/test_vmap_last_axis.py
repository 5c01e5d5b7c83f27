"""`vmap` over the last axis equals `jax.vmap`, and keeps the batch in the last axis of intermediate arrays."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.batching import vmap_last_axis

BATCH_SIZE = 7
X = np.random.default_rng(1).normal(size=(3, BATCH_SIZE))
M = np.random.default_rng(2).normal(size=(3, 3, BATCH_SIZE))
S = np.random.default_rng(3).normal(size=BATCH_SIZE)
SHARED = np.int64(4)


def scanned(x: Any, m: Any, s: Any, shared: Any) -> Any:
    """A carry that becomes batched only in the second iteration, beside one that never does."""

    def body(carry: Any, row: Any) -> Any:
        own, later, common = carry
        return (own + row @ jnp.ones(3), later + own, common + 1.0), (jnp.sum(row), common)

    zero = jnp.zeros(())
    return jax.lax.scan(body, (zero, zero, zero), m)


def branched(x: Any, m: Any, s: Any, shared: Any) -> Any:
    """One conditional on a shared index, two on batched ones."""
    shared = jax.lax.cond(shared > 3, lambda: (x * 2.0, jnp.zeros(())), lambda: (jnp.ones(3), s))
    own = jax.lax.cond(s > 0.0, lambda: m[0], lambda: x)
    which = jax.lax.switch(
        (s > 0.0).astype(jnp.int32) + (s > 1.0).astype(jnp.int32), [lambda: s, lambda: x[0], lambda: x[1]]
    )
    return shared, own, which


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "elementwise": lambda x, m, s, shared: (
        jnp.sin(x) * s + 2.0,
        jnp.where(s > 0.0, x, -x),
        jnp.where(shared > 3, x, s),
    ),
    "reductions": lambda x, m, s, shared: (jnp.sum(m, axis=1), jnp.max(x), jnp.argmin(x), jnp.all(x > s), jnp.prod(x)),
    "slices": lambda x, m, s, shared: (m[1:, 0], x[::2], x[shared - 2], jax.lax.dynamic_slice(m, (shared, 0), (2, 1))),
    "indexing": lambda x, m, s, shared: (
        x[np.array([2, 0, 0, 1])],
        m[np.array([0, 2, 2])],
        m[:, np.array([1, 1])],
        m[np.array([0, 2]), np.array([1, 0])],
        jnp.arange(3.0)[np.array([2, 2])] * s,
        jnp.take_along_axis(m, np.array([[0, 2], [1, 1], [2, 0]]), axis=1),
        x[jnp.stack([jnp.argmax(x), jnp.argmin(x)])],
    ),
    "batched indices": lambda x, m, s, shared: (m[jnp.argmax(x)], jax.lax.dynamic_slice(x, (jnp.argmin(x),), (1,))),
    "shapes": lambda x, m, s, shared: (m.T, m.reshape(9), x[:, None] * m, jnp.pad(x, 1), jnp.diag(x), jnp.flip(x)),
    "stacking": lambda x, m, s, shared: (
        jnp.stack([x[0], s, shared.astype(jnp.float64)]),
        jnp.concatenate([x, jnp.ones(2), s[None]]),
    ),
    "products": lambda x, m, s, shared: (m @ x, jnp.linalg.inv(m), jnp.cross(x, m[0])),
    "shared result": lambda x, m, s, shared: (jnp.arange(3) * shared, x),
    "sorted": lambda x, m, s, shared: (jnp.sort(x), jnp.cumsum(x)),
    "while loop": lambda x, m, s, shared: jax.lax.while_loop(
        lambda c: c[0] < 3.0, lambda c: (c[0] + 1.0, c[1] * s), (s, x)
    ),
    "custom derivative": lambda x, m, s, shared: (jax.nn.relu(x), jax.grad(lambda y: jnp.sum(jnp.sqrt(y * y)))(x)),
    "scan": scanned,
    "branches": branched,
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_results_are_those_of_vmap(name: str) -> None:
    axes = (-1, -1, -1, None)
    expected = jax.vmap(FUNCTIONS[name], in_axes=axes, out_axes=-1)(X, M, S, SHARED)
    found = jax.jit(vmap_last_axis.vmap(FUNCTIONS[name], axes, -1))(X, M, S, SHARED)
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for ours, theirs in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert ours.shape == theirs.shape
        assert ours.dtype == theirs.dtype
        np.testing.assert_allclose(ours, theirs, rtol=1e-13, atol=1e-14)


def test_shared_results_have_no_batch_axis() -> None:
    def function(record: dict[str, Any], count: Any) -> Any:
        return {"own": record["a"] * record["b"][0], "common": count + 1, "none": None}

    batched = vmap_last_axis.vmap(function, ({"a": -1, "b": None}, None), {"own": -1, "common": None, "none": None})
    found = batched({"a": X, "b": jnp.ones(2)}, SHARED)
    assert found["own"].shape == (3, BATCH_SIZE)
    assert int(found["common"]) == SHARED + 1
    assert found["none"] is None


def test_a_batched_result_cannot_be_declared_shared() -> None:
    with pytest.raises(ValueError, match="out_axes"):
        vmap_last_axis.vmap(lambda x: x * 2.0, (-1,), None)(X)


def test_stacking_components_needs_no_transposition() -> None:
    """The lowered program of a function that splits and stacks vectors has no transposition."""

    def function(x: Any, m: Any) -> Any:
        y = jnp.stack([x[1] * x[2], x[2] - x[0], x[0]])
        return jnp.concatenate([jnp.sum(m * y[None, :], axis=1), m[np.array([2, 0, 0]), 1], y])

    text = jax.jit(vmap_last_axis.vmap(function, (-1, -1), -1)).lower(X, M).as_text()
    assert "transpose" not in text


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


def test_shared_arrays_are_broadcast_once() -> None:
    every = vmap_last_axis.vmap(lambda x: (x[0] * 2.0 + 2.0, x * 2.0, x - 2.0), (-1,), -1)
    traced = str(jax.make_jaxpr(every)(X))
    assert traced.count("broadcast_in_dim") == 2  # as a number and as three


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


def test_named_scopes_are_kept() -> None:
    def function(x: Any) -> Any:
        with jax.named_scope("sense"):
            return jnp.sin(x)

    text = jax.jit(vmap_last_axis.vmap(function, (-1,), -1)).lower(X).as_text(debug_info=True)
    assert "sense/sin" in text


@jax.custom_jvp
def steep(x: Any) -> Any:
    """A function with an arbitrary custom derivative."""
    return x * 0.0


@steep.defjvp
def _steep_jvp(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
    return steep(primals[0]), 5.0 * tangents[0]


def test_custom_derivatives_are_kept() -> None:
    every = vmap_last_axis.vmap(lambda x: steep(x) + jax.lax.stop_gradient(x), in_axes=-1, out_axes=-1)
    np.testing.assert_array_equal(every(X), X)
    np.testing.assert_array_equal(jax.grad(lambda x: jnp.sum(every(x)))(X), np.full_like(X, 5.0))
    np.testing.assert_array_equal(jax.jvp(every, (X,), (X,))[1], 5.0 * X)
