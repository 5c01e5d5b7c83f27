"""`vmap` over the last axis keeps the batch there in intermediate arrays, and refuses what it does not honour."""

import itertools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental import io_callback

from rpojax.batching import vmap_last_axis
from rpojax.batching.jax_programs import any_of_batch
from rpojax.errors import BatchingError

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
    with pytest.raises(BatchingError, match="out_axes"):
        vmap_last_axis.vmap(lambda x: x * 2.0, (-1,), None)(X)


def test_stacking_components_needs_no_transposition() -> None:
    """The lowered program of a function that splits and stacks vectors has no transposition."""

    def function(x: Any, m: Any) -> Any:
        y = jnp.stack([x[1] * x[2], x[2] - x[0], x[0]])
        return jnp.concatenate([jnp.sum(m * y[None, :], axis=1), m[np.array([2, 0, 0]), 1], y])

    text = jax.jit(vmap_last_axis.vmap(function, (-1, -1), -1)).lower(X, M).as_text()
    assert "transpose" not in text


def test_shared_arrays_are_broadcast_once() -> None:
    every = vmap_last_axis.vmap(lambda x: (x[0] * 2.0 + 2.0, x * 2.0, x - 2.0), (-1,), -1)
    traced = str(jax.make_jaxpr(every)(X))
    assert traced.count("broadcast_in_dim") == 2  # as a number and as three


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


def test_rematerialised_functions_stay_so() -> None:
    """Reverse mode evaluates them again, under the policy of the function."""
    policy = jax.checkpoint_policies.everything_saveable
    every = vmap_last_axis.vmap(jax.checkpoint(jnp.sin, policy=policy, prevent_cse=False), (-1,), -1)
    traced = jax.make_jaxpr(jax.grad(lambda x: jnp.sum(every(x))))(X)
    (kept,) = [equation for equation in jax.make_jaxpr(every)(X).eqns if "policy" in equation.params]
    assert (kept.params["policy"], kept.params["prevent_cse"]) == (policy, False)
    again = vmap_last_axis.vmap(jax.checkpoint(lambda x: jnp.sin(jnp.sin(x))), (-1,), -1)
    traced = str(jax.make_jaxpr(jax.grad(lambda x: jnp.sum(again(x))))(X))
    plain = vmap_last_axis.vmap(lambda x: jnp.sin(jnp.sin(x)), (-1,), -1)
    assert traced.count(" sin ") == 1 + str(jax.make_jaxpr(jax.grad(lambda x: jnp.sum(plain(x))))(X)).count(" sin ")


def test_numbers_of_python_keep_the_type_of_arrays() -> None:
    every = vmap_last_axis.vmap(lambda x, factor: x * factor, (-1, None), -1)
    assert every(jnp.asarray(X, jnp.float32), 2.0).dtype == jnp.float32
    assert every(jnp.asarray(X, jnp.float32), 2).dtype == jnp.float32


def test_random_keys_are_batched() -> None:
    keys = jax.random.split(jax.random.key(5), BATCH_SIZE)
    function = jax.jit(vmap_last_axis.vmap(lambda key: jax.random.normal(jax.random.fold_in(key, 3), (2,)), (-1,), -1))
    expected = jax.vmap(lambda key: jax.random.normal(jax.random.fold_in(key, 3), (2,)), out_axes=-1)(keys)
    np.testing.assert_array_equal(function(keys), expected)


@pytest.mark.parametrize(
    ("in_axes", "arguments", "found"),
    [
        ((0,), (X,), "found 0, expected -1 or None"),
        ((1,), (X,), "found 1"),
        (({"a": -1},), ({"a": X, "b": X},), "found another tree"),
        ((-1, -1), (X,), "found another tree"),
        ((None,), (X,), "no argument with a batch axis"),
        ((-1,), (np.zeros((3, 0)),), r"batches of \[0\] elements"),
        ((-1, -1), (X, X[:, 1:]), r"batches of \[6, 7\] elements"),
        ((-1, -1), (X, 2.0), "found -1 for a number"),
    ],
)
def test_axes_that_are_not_honoured_are_refused(in_axes: Any, arguments: Any, found: str) -> None:
    with pytest.raises(BatchingError, match=found):
        vmap_last_axis.vmap(lambda *values: values[0], in_axes, -1)(*arguments)


def test_other_axes_of_results_are_refused() -> None:
    with pytest.raises(BatchingError, match="out_axes: found 0"):
        vmap_last_axis.vmap(lambda x: x, (-1,), 0)(X)


def printing(x: Any) -> Any:
    """A function that prints."""
    jax.debug.print("{}", x)
    return x


def speaking(x: Any) -> Any:
    """A function that calls the host in order, in a branch."""

    def call() -> Any:
        jax.debug.callback(print, x, ordered=True)
        return x

    return jax.lax.cond(x[0] > 0.0, call, lambda: x)


def asking(x: Any) -> Any:
    """A function that asks the host in a loop."""
    kind = jax.ShapeDtypeStruct((), float)
    return jax.lax.scan(lambda c, e: (c + io_callback(np.sin, kind, e), None), jnp.zeros(()), x)[0]


def remembering(x: Any) -> Any:
    """A function that writes to an array of its own."""
    memory = jax.new_ref(jnp.zeros(3))
    memory[...] += x
    return jax.freeze(memory)


@pytest.mark.parametrize(
    ("function", "kind"), [(printing, "DebugEffect"), (speaking, "OrderedDebugEffect"), (asking, "IOEffect")]
)
def test_effects_are_refused(function: Any, kind: str) -> None:
    with pytest.raises(BatchingError, match=rf"effects \({kind}\)"):
        vmap_last_axis.vmap(function, (-1,), -1)(X)


def test_references_are_refused() -> None:
    with pytest.raises(BatchingError, match="effects"):
        vmap_last_axis.vmap(remembering, (-1,), -1)(X)


NAMED = [lambda x: jax.lax.psum(x, "runs"), lambda x: x * jax.lax.axis_index("runs").astype(float)]


@pytest.mark.parametrize("function", NAMED)
def test_named_axes_are_refused(function: Any) -> None:
    every = vmap_last_axis.vmap(function, (-1,), -1)
    with pytest.raises(BatchingError, match="NamedAxisEffect"):
        jax.vmap(every, axis_name="runs")(np.stack([X, X]))


def test_unknown_functions_within_a_function_are_refused() -> None:
    composite = jax.lax.composite(jnp.sin, "rpojax.sine")
    with pytest.raises(BatchingError, match="primitive 'composite'"):
        vmap_last_axis.vmap(composite, (-1,), -1)(X)


def costly_if_needed(x: Any, s: Any) -> Any:
    """The sum of a vector where it is above a number, else zero; a branch of the whole batch."""
    needed = jnp.sum(x) > s
    costly = jax.lax.cond(any_of_batch(needed), lambda: jnp.sum(jnp.sinh(x)), lambda: jnp.zeros(()))
    return jnp.where(needed, costly, 0.0), any_of_batch(needed)


@pytest.mark.parametrize("transform", [jax.vmap, vmap_last_axis.vmap])
def test_a_branch_on_any_of_a_batch_stays_a_branch(transform: Callable[..., Any]) -> None:
    x = jnp.array([[0.1, 0.2, 0.3], [1.0, 1.0, 1.0]]).T
    batched = transform(costly_if_needed, in_axes=(-1, None), out_axes=(-1, None))
    text = str(jax.make_jaxpr(batched)(x, 2.0))
    assert text.count("cond[") == 1
    for limit, values, any_above in ((2.0, [0.0, 3.0 * np.sinh(1.0)], True), (9.0, [0.0, 0.0], False)):
        found, flag = jax.jit(batched)(x, limit)
        np.testing.assert_allclose(found, values, rtol=1e-12)
        assert bool(flag) == any_above


@pytest.mark.parametrize(("inner", "outer"), list(itertools.product([jax.vmap, vmap_last_axis.vmap], repeat=2)))
def test_any_of_a_batch_of_batches_is_that_of_all(inner: Callable[..., Any], outer: Callable[..., Any]) -> None:
    def of_members(x: Any) -> Any:
        return inner(lambda each: any_of_batch(each > 0.0), in_axes=-1, out_axes=None)(x)

    flags = outer(of_members, in_axes=-1, out_axes=None)
    x = np.full((3, 4), -1.0)
    assert not jax.jit(flags)(x)
    x[1, 2] = 1.0
    assert jax.jit(flags)(x)
    assert jax.jit(of_members)(x[:, 2])
    assert not jax.jit(of_members)(x[:, 0])
