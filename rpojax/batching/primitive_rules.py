"""Batching rules of pure operations for a batch in the last axis."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from rpojax.batching.batched_value import Batch, BatchedValue
from rpojax.batching.jax_programs import Form, Operation

Rule = Callable[[Operation, list[BatchedValue], Batch], list[Any] | None]
"""From an operation, its operands and the batch to the batched results; None where the rule does not apply."""


def _elementwise(operation: Operation, operands: list[BatchedValue], batch: Batch) -> list[Any]:
    # Some primitives take a scalar beside an array, such as `clamp`.
    shape = max((value.shape for value in operands), key=len)
    return operation.evaluate(*(batch.broadcast(value, shape) for value in operands))


def _one_operand(operation: Operation, operands: list[BatchedValue], batch: Batch) -> list[Any]:
    return operation.evaluate_batched([operands[0].array], batch.size)


def _join(operation: Operation, operands: list[BatchedValue], batch: Batch) -> list[Any]:
    return operation.evaluate_batched(list(map(batch.broadcast, operands)), batch.size)


def _select(operation: Operation, operands: list[BatchedValue], batch: Batch) -> list[Any]:
    index, *cases = operands
    if not index.is_batched and jnp.ndim(index.array) == 0:
        return operation.evaluate(index.array, *map(batch.broadcast, cases))
    return _elementwise(operation, operands, batch)


def _dynamic_slice(operation: Operation, operands: list[BatchedValue], batch: Batch) -> list[Any] | None:
    array, *starts = operands
    if not array.is_batched or any(start.is_batched for start in starts):
        return None
    batch_start = lax.full((), 0, jnp.result_type(starts[0].array))
    return operation.evaluate_batched([array.array, *(start.array for start in starts), batch_start], batch.size)


def _gather(operation: Operation, operands: list[BatchedValue], batch: Batch) -> list[Any] | None:
    array, indices = operands
    if not array.is_batched or indices.is_batched:
        return None
    return operation.evaluate_batched([array.array, indices.array], batch.size)


def _pad(operation: Operation, operands: list[BatchedValue], batch: Batch) -> list[Any] | None:
    array, fill_value = operands
    if fill_value.is_batched:
        return None
    return operation.evaluate_batched([batch.broadcast(array), fill_value.array], batch.size)


def _change_width(operation: Operation, operands: list[BatchedValue], _: Batch) -> list[Any]:
    # With the batch in front, since the axis that appears or disappears is the last one.
    return jax.vmap(operation.evaluate, out_axes=-1)(jnp.moveaxis(operands[0].array, -1, 0))


RULES: dict[Form, Rule] = {
    Form.ELEMENTWISE: _elementwise,
    Form.ONE_OPERAND: _one_operand,
    Form.JOIN: _join,
    Form.SELECT: _select,
    Form.DYNAMIC_SLICE: _dynamic_slice,
    Form.GATHER: _gather,
    Form.PAD: _pad,
    Form.CHANGE_OF_WIDTH: _change_width,
}
"""Batching rules of pure operations by their form; at least one of the operands is batched."""
