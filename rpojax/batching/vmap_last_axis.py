"""`vmap` with the batch in the last axis of every intermediate array.

`jax.vmap` lets each operation choose the batch axis, and stacking moves it to the front: compiled loops then run over
the three components of a vector. Here they always run over the batch, whose elements lie side by side in memory.
Results are those of `jax.vmap` up to rounding. Functions with custom derivatives, rematerialised functions and `while`
loops are left to `jax.vmap` as a whole; what is not known to work is refused.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.batching import jax_programs
from rpojax.batching.batched_interpreter import BatchedInterpreter
from rpojax.batching.batched_value import BatchedValue
from rpojax.errors import BatchingError


def vmap(function: Callable[..., Any], in_axes: Any, out_axes: Any) -> Callable[..., Any]:
    """`function` mapped over the last axis of its arguments and results.

    Axes are given as to `jax.vmap`: -1 for arrays with a batch axis, None for arrays shared by the whole batch.
    Call it inside a compiled function: outside, all intermediate arrays are kept until it returns.

    Raises:
        BatchingError: other axes, no batch or an empty one, batches of different sizes, a result with `out_axes` None
            that depends on the element of the batch, or a function with effects or with functions in it that
            the batching does not know.
    """

    def batched(*args: Any) -> Any:
        leaves, tree = jax.tree.flatten(args)
        axes = _leaf_axes("in_axes", in_axes, args)
        operands = [BatchedValue(_as_array(leaf), axis is not None) for leaf, axis in zip(leaves, axes, strict=True)]
        size = _batch_size(operands)
        elements = jax.tree.unflatten(tree, map(_element_shape, leaves, operands))
        closed, shape = jax.make_jaxpr(function, return_shape=True)(*elements)
        program = jax_programs.pure_program(closed)
        interpreter = BatchedInterpreter(size)
        results = interpreter.evaluate(program, operands)
        wanted = [axis is not None for axis in _leaf_axes("out_axes", out_axes, shape)]
        if any(value.is_batched and not batched for value, batched in zip(results, wanted, strict=True)):
            raise BatchingError("out_axes: found None for a result that differs from item to item, expected -1")
        arrays = interpreter.to_arrays(results, wanted)
        return jax.tree.unflatten(jax.tree.structure(shape), arrays)

    return batched


def _leaf_axes(name: str, axes: Any, tree: Any) -> list[int | None]:
    """The axis of each leaf of a tree, from axes given for whole branches of it."""
    flat: list[int | None] = []

    def repeat(axis: int | None, branch: Any) -> None:
        if axis not in (-1, None):
            raise BatchingError(f"{name}: found {axis!r}, expected -1 or None")
        flat.extend([axis] * len(jax.tree.leaves(branch)))

    try:
        jax.tree.map(repeat, axes, tree, is_leaf=lambda node: node is None)
    except ValueError as error:
        raise BatchingError(f"{name}: found another tree than that of the arrays ({error})") from None
    return flat


def _as_array(leaf: Any) -> Any:
    return leaf if hasattr(leaf, "dtype") else np.asarray(leaf, dtype=jax.typeof(leaf).dtype)


def _batch_size(operands: Sequence[BatchedValue]) -> int:
    """The size that all batched arguments share."""
    shapes = [jnp.shape(value.array) for value in operands if value.is_batched]
    if not shapes:
        raise BatchingError("in_axes: found no argument with a batch axis, expected at least one")
    if () in shapes:
        raise BatchingError("in_axes: found -1 for a number, expected an array with a batch axis")
    sizes = sorted({shape[-1] for shape in shapes})
    if len(sizes) > 1 or sizes[0] == 0:
        raise BatchingError(f"in_axes: found batches of {sizes} elements, expected one size from 1")
    return sizes[0]


def _element_shape(leaf: Any, value: BatchedValue) -> jax.ShapeDtypeStruct:
    """Shape of one element; a number of Python takes the type of the arrays that it meets."""
    kind = jax.typeof(leaf)
    return jax.ShapeDtypeStruct(value.shape, kind.dtype, weak_type=kind.weak_type)
