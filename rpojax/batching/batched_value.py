"""Arrays with or without a batch in their last axis, and their broadcast over it."""

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
