"""One program on several devices together: each computes its share of the rows of a batch, with exchange of data."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array

T = TypeVar("T")

_ROWS = "rows"
_WHOLE, _BY_ROWS = PartitionSpec(), PartitionSpec(_ROWS)


class DeviceMesh:
    """Devices that share the rows, the first axis, of all arrays of a batch."""

    def __init__(self, devices: Sequence[Any]) -> None:
        self._mesh = Mesh(np.array(devices), (_ROWS,))
        self.sharding = NamedSharding(self._mesh, _BY_ROWS)
        self._whole = NamedSharding(self._mesh, _WHOLE)

    @property
    def size(self) -> int:
        """Number of devices."""
        return self._mesh.size

    def place(self, arrays: T) -> T:
        """A pytree of arrays with their rows spread over the devices."""
        return jax.device_put(arrays, self.sharding)

    def copy(self, arrays: T) -> T:
        """A pytree of arrays, whole on every device."""
        return jax.device_put(arrays, self._whole)

    def by_rows(self, function: Callable[..., T], whole: int = 0) -> Callable[..., T]:
        """`function` called by each device with its share of the rows; results are joined.

        The first `whole` arguments are the same for all devices.
        """

        def shared(*arguments: Any) -> T:
            specs = (*[_WHOLE] * whole, *[_BY_ROWS] * (len(arguments) - whole))
            program = jax.shard_map(function, mesh=self._mesh, in_specs=specs, out_specs=_BY_ROWS, check_vma=False)
            return program(*arguments)

        return shared


def gather_rows(share: Array) -> Array:
    """Rows of all devices, from the share of each; for functions called `by_rows`."""
    return jax.lax.all_gather(share, _ROWS, tiled=True)


def own_rows(rows: Array) -> Array:
    """Share of this device in the rows of all; for functions called `by_rows`."""
    count = rows.shape[0] // jax.lax.axis_size(_ROWS)
    return jax.lax.dynamic_slice_in_dim(rows, jax.lax.axis_index(_ROWS) * count, count)


def padded_batches(count: int, size: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Indices (size,) of the rows of each batch, the last one padded with the last of `count` rows, and which count."""
    for first in range(0, count, size):
        rows = np.arange(first, first + size)
        yield np.minimum(rows, count - 1), rows < count
