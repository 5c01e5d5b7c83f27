"""`vmap` over the last axis equals `jax.vmap`, in results and in derivatives of both modes."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from function_zoo import ZOO, Case
from hypothesis import given
from hypothesis import strategies as st

from rpojax.batching import vmap_last_axis

BATCH_SIZE = 4
ROUNDING = {"rtol": 1e-12, "atol": 1e-12}
"""Numbers of the zoo are near 1, and are rounded differently where XLA contracts or reorders."""

NUMBERS = np.random.default_rng(1)
BATCHED = tuple(NUMBERS.normal(size=(*shape, BATCH_SIZE)) for shape in ((3,), (3, 3), ()))
DIRECTIONS = tuple(NUMBERS.normal(size=value.shape) for value in BATCHED)
AXES = {"all batched": (-1, -1, -1), "matrix batched": (None, -1, None)}


def weighted_sum(results: Any) -> jax.Array:
    """Sum of all floating-point results, with other weights for each number."""
    leaves = [leaf for leaf in jax.tree.leaves(results) if jnp.issubdtype(leaf.dtype, jnp.floating)]
    return sum(
        (jnp.sum(leaf * jnp.cos(jnp.arange(leaf.size)).reshape(leaf.shape).astype(leaf.dtype))).astype(float)
        for leaf in leaves
    )


def derivatives(every: Callable[..., Any], case: Case, arguments: Any, directions: Any) -> dict[str, Any]:
    """Results of a batched function, and its derivatives."""
    found = {"results": every(*arguments)}
    if case.forward:
        found["forward"] = jax.jvp(every, arguments, directions)
    if case.reverse:
        found["reverse"] = jax.grad(lambda values: weighted_sum(every(*values)))(arguments)
    return found


def assert_equal_derivatives(case: Case, axes: tuple[int | None, ...]) -> None:
    """Asserts that both transforms have the same results and derivatives."""
    arguments, directions = (
        tuple(value if axis else value[..., 0] for value, axis in zip(values, axes, strict=True))
        for values in (BATCHED, DIRECTIONS)
    )

    @jax.jit
    def both(*values: Any) -> Any:
        transforms = vmap_last_axis.vmap, jax.vmap
        return [derivatives(vmap(case.function, axes, -1), case, *values) for vmap in transforms]

    ours, theirs = both(arguments, directions)
    assert jax.tree.structure(ours) == jax.tree.structure(theirs)
    for (path, found), expected in zip(jax.tree.leaves_with_path(ours), jax.tree.leaves(theirs), strict=True):
        assert (found.shape, found.dtype) == (expected.shape, expected.dtype)
        if found.dtype != jax.dtypes.float0:
            np.testing.assert_allclose(found, expected, **ROUNDING, err_msg=jax.tree_util.keystr(path))


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("name", ZOO)
def test_results_and_derivatives_are_those_of_vmap(name: str, axes: str) -> None:
    assert_equal_derivatives(ZOO[name], AXES[axes])


STEPS: list[Callable[[Any, Any], Any]] = [
    lambda v, s: jnp.sin(v) + s,
    lambda v, s: jnp.stack([v[1], s, v[0] * v[2]]),
    lambda v, s: v[np.array([2, 0, 0])] - jnp.flip(v),
    lambda v, s: jax.lax.cond(s > v[0], lambda: v * s, lambda: jnp.cos(v)),
    lambda v, s: jax.lax.scan(lambda c, e: (c + e * s, c), v, jnp.arange(3.0))[0] + v,
    lambda v, s: jnp.concatenate([v[1:], jnp.max(v)[None]]),
    lambda v, s: jnp.outer(v, v)[:, jnp.argmax(v)],
    lambda v, s: jax.checkpoint(jnp.tanh)(v) * jnp.sin(v),
    lambda v, s: jnp.full(3, 0.5) + jnp.sum(v),
]


@given(
    steps=st.lists(st.sampled_from(range(len(STEPS))), min_size=2, max_size=6),
    axes=st.sampled_from([(-1, -1, -1), (-1, None, None), (None, None, -1), (None, -1, None)]),
)
def test_any_sequence_of_operations_has_the_results_and_derivatives_of_vmap(
    steps: list[int], axes: tuple[int | None, ...]
) -> None:
    def function(x: Any, m: Any, s: Any) -> Any:
        values = [x, m[0]]
        for step in steps:
            values.append(STEPS[step](values[-1], s) + 0.1 * values[-2])
        return values

    assert_equal_derivatives(Case(function), axes)
