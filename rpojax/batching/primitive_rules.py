"""Batching rules of JAX primitives for a batch in the last axis; primitives without a rule go through `jax.vmap`."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax


class BatchedValue(NamedTuple):
    """An array, and whether its last axis is the batch axis; if not, all elements of the batch share it."""

    array: Any
    is_batched: bool

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one element of the batch."""
        return jnp.shape(self.array)[: -1 if self.is_batched else None]

    @property
    def identity(self) -> Any:
        """Key that is equal only for the same numbers of the same type, while both arrays are alive."""
        array = self.array
        key = (str(array.dtype), array.shape, array.tobytes()) if isinstance(array, np.ndarray) else id(array)
        return key, self.is_batched


class Batch:
    """A batch of fixed size, with the shared arrays that have been broadcast over it so far.

    Attributes:
        size: number of elements
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._broadcasts: dict[Any, tuple[BatchedValue, Any]] = {}

    def broadcast(self, value: BatchedValue, shape: tuple[int, ...] = ()) -> Any:
        """The array with a batch axis; a scalar also gets the leading axes `shape`. Each array is broadcast once."""
        element_shape = value.shape
        if value.is_batched and (element_shape or not shape):
            return value.array
        key = value.identity, element_shape or shape
        if key not in self._broadcasts:
            target_shape = (*(element_shape or shape), self.size)
            axes = (len(shape),) if value.is_batched else range(len(element_shape))
            self._broadcasts[key] = value, lax.broadcast_in_dim(value.array, target_shape, axes)
        return self._broadcasts[key][1]


Rule = Callable[[Any, list[BatchedValue], Batch], Any]
"""From an equation, its operands and the batch to the batched result; None where the rule does not apply."""


def _elementwise(equation: Any, operands: list[BatchedValue], batch: Batch) -> Any:
    # Some primitives take a scalar beside an array, such as `clamp`.
    shape = max((value.shape for value in operands), key=len)
    return equation.primitive.bind(*(batch.broadcast(value, shape) for value in operands), **equation.params)


def _bitcast(equation: Any, operands: list[BatchedValue], batch: Batch) -> Any:
    # A bitcast to another width appends an axis, which would come after the batch axis.
    same_width = operands[0].array.dtype.itemsize == np.dtype(equation.params["new_dtype"]).itemsize
    return _elementwise(equation, operands, batch) if same_width else None


def _select(equation: Any, operands: list[BatchedValue], batch: Batch) -> Any:
    index, *cases = operands
    if not index.is_batched and jnp.ndim(index.array) == 0:
        return lax.select_n(index.array, *map(batch.broadcast, cases))
    return _elementwise(equation, operands, batch)


def _slice(equation: Any, operands: list[BatchedValue], batch: Batch) -> Any:
    params = equation.params
    strides = None if params["strides"] is None else (*params["strides"], 1)
    return lax.slice(operands[0].array, (*params["start_indices"], 0), (*params["limit_indices"], batch.size), strides)


def _dynamic_slice(equation: Any, operands: list[BatchedValue], batch: Batch) -> Any:
    array, *starts = operands
    if not array.is_batched or any(start.is_batched for start in starts):
        return None
    batch_start = jnp.zeros((), dtype=jnp.result_type(starts[0].array))
    return lax.dynamic_slice(
        array.array, (*(start.array for start in starts), batch_start), (*equation.params["slice_sizes"], batch.size)
    )


def _gather(equation: Any, operands: list[BatchedValue], batch: Batch) -> Any:
    array, indices = operands
    if not array.is_batched or indices.is_batched:
        return None
    params, numbers = dict(equation.params), equation.params["dimension_numbers"]
    params["dimension_numbers"] = numbers._replace(
        offset_dims=(*numbers.offset_dims, len(equation.outvars[0].aval.shape))
    )
    params["slice_sizes"] = (*params["slice_sizes"], batch.size)
    return equation.primitive.bind(array.array, indices.array, **params)


def _squeeze(equation: Any, operands: list[BatchedValue], _: Batch) -> Any:
    return lax.squeeze(operands[0].array, equation.params["dimensions"])


def _broadcast_in_dim(equation: Any, operands: list[BatchedValue], batch: Batch) -> Any:
    shape = (*equation.params["shape"], batch.size)
    axes = (*equation.params["broadcast_dimensions"], len(shape) - 1)
    return lax.broadcast_in_dim(operands[0].array, shape, axes)


def _concatenate(equation: Any, operands: list[BatchedValue], batch: Batch) -> Any:
    return lax.concatenate(list(map(batch.broadcast, operands)), equation.params["dimension"])


def _stack(equation: Any, operands: list[BatchedValue], batch: Batch) -> Any:
    return jnp.stack(list(map(batch.broadcast, operands)), axis=equation.params["axis"])


def _pad(equation: Any, operands: list[BatchedValue], batch: Batch) -> Any:
    array, fill_value = operands
    if fill_value.is_batched:
        return None
    return lax.pad(batch.broadcast(array), fill_value.array, (*equation.params["padding_config"], (0, 0, 0)))


def _transpose(equation: Any, operands: list[BatchedValue], _: Batch) -> Any:
    permutation = equation.params["permutation"]
    return lax.transpose(operands[0].array, (*permutation, len(permutation)))


def _reshape(equation: Any, operands: list[BatchedValue], batch: Batch) -> Any:
    return lax.reshape(operands[0].array, (*equation.params["new_sizes"], batch.size))


def _reduce(equation: Any, operands: list[BatchedValue], _: Batch) -> Any:
    """Reductions over axes counted from the front, which the trailing batch axis leaves as they are."""
    return equation.primitive.bind(operands[0].array, **equation.params)


_ELEMENTWISE = (
    "abs acos add and asin atan atan2 cbrt ceil clamp convert_element_type copy cos cosh div "
    "eq erf erf_inv erfc exp exp2 expm1 floor ge gt integer_pow is_finite le log log1p logistic lt max min mul ne "
    "neg nextafter not or pow rem round rsqrt shift_left shift_right_arithmetic shift_right_logical sign sin sinh "
    "sqrt square stop_gradient sub tan tanh xor"
)

_REDUCTIONS = "argmax argmin reduce_and reduce_max reduce_min reduce_or reduce_prod reduce_sum"

RULES: dict[str, Rule] = {
    **dict.fromkeys(_ELEMENTWISE.split(), _elementwise),
    **dict.fromkeys(_REDUCTIONS.split(), _reduce),
    "bitcast_convert_type": _bitcast,
    "broadcast_in_dim": _broadcast_in_dim,
    "concatenate": _concatenate,
    "dynamic_slice": _dynamic_slice,
    "gather": _gather,
    "pad": _pad,
    "reshape": _reshape,
    "select_n": _select,
    "slice": _slice,
    "squeeze": _squeeze,
    "stack": _stack,
    "transpose": _transpose,
}
"""Batching rules by name of the primitive."""
