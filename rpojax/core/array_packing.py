"""Records of many small arrays packed into a few long ones, since each argument of a compiled call costs time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

_LARGEST_PACKED_SIZE = 4096
"""Larger arrays are not packed, since packing copies them."""


class PackedLayout:
    """Position of each array of a record in the packed arrays: one for every dtype, then the large ones unchanged.

    Create layouts by `of`: equal layouts are the same object, and are compared by identity.
    """

    def __init__(self, tree: Any, shapes: tuple[tuple[int, ...], ...], dtypes: tuple[str, ...]) -> None:
        sizes = [int(np.prod(shape, dtype=np.int64)) for shape in shapes]
        self._tree, self._shapes = tree, shapes
        self._large = [index for index, size in enumerate(sizes) if size > _LARGEST_PACKED_SIZE]
        small = [index for index, size in enumerate(sizes) if size <= _LARGEST_PACKED_SIZE]
        kinds = dict.fromkeys(dtypes[index] for index in small)
        self._dtype_groups = [[index for index in small if dtypes[index] == kind] for kind in kinds]
        ends = [np.cumsum([sizes[index] for index in group]).tolist() for group in self._dtype_groups]
        self._slices = [
            [(index, end - sizes[index], end, shapes[index]) for index, end in zip(group, group_ends, strict=True)]
            for group, group_ends in zip(self._dtype_groups, ends, strict=True)
        ]

    @staticmethod
    def of(record: Any) -> "PackedLayout":
        """Layout of a record of arrays."""
        leaves, tree = jax.tree.flatten(record)
        return _layout(tree, tuple(np.shape(leaf) for leaf in leaves), tuple(str(leaf.dtype) for leaf in leaves))

    def pack(self, record: Any, concatenate: Callable[[Sequence[Any]], Any] = jnp.concatenate) -> tuple[Any, ...]:
        """Packed arrays of a record."""
        leaves = jax.tree.leaves(record)
        parts = [concatenate([leaves[index].reshape(-1) for index in group]) for group in self._dtype_groups]
        return (*parts, *(leaves[index] for index in self._large))

    def unpack(self, packed: Sequence[Any]) -> Any:
        """Record from its packed arrays, as views where these are of numpy."""
        leaves: list[Any] = [None] * len(self._shapes)
        count = len(self._slices)
        for array, slices in zip(packed[:count], self._slices, strict=True):
            for index, begin, end, shape in slices:
                leaves[index] = array[begin:end].reshape(shape)
        for array, index in zip(packed[count:], self._large, strict=True):
            leaves[index] = array
        return jax.tree.unflatten(self._tree, leaves)


@cache
def _layout(tree: Any, shapes: tuple[tuple[int, ...], ...], dtypes: tuple[str, ...]) -> PackedLayout:
    return PackedLayout(tree, shapes, dtypes)


@dataclass(frozen=True)
class PackedRecord:
    """A record in packed form.

    Attributes:
        layout: how the record is packed
        arrays: packed arrays
    """

    layout: PackedLayout
    arrays: tuple[Any, ...]

    @classmethod
    def of(cls, record: Any) -> "PackedRecord":
        """Packs a record on the host."""
        on_host = jax.tree.map(np.asarray, record)
        layout = PackedLayout.of(on_host)
        return cls(layout, layout.pack(on_host, np.concatenate))

    def to_numpy(self) -> Any:
        """The record with numpy arrays."""
        return self.layout.unpack([np.asarray(array) for array in self.arrays])


class PackedFunction:
    """A function from records to a tuple of records, compiled as a function of packed records."""

    def __init__(self, function: Callable[..., tuple[Any, ...]]) -> None:
        self._function = function
        self._output_layouts: dict[tuple[PackedLayout, ...], tuple[PackedLayout, ...]] = {}
        self._compiled = jax.jit(self._call, static_argnums=0)

    def __call__(self, *arguments: PackedRecord) -> tuple[PackedRecord, ...]:
        """Packed results for packed arguments."""
        input_layouts = tuple(argument.layout for argument in arguments)
        results = self._compiled(input_layouts, *(argument.arrays for argument in arguments))
        return tuple(PackedRecord(*pair) for pair in zip(self._output_layouts[input_layouts], results, strict=True))

    def _call(
        self, input_layouts: tuple[PackedLayout, ...], *packed: tuple[jax.Array, ...]
    ) -> tuple[tuple[jax.Array, ...], ...]:
        records = self._function(*(layout.unpack(each) for layout, each in zip(input_layouts, packed, strict=True)))
        output_layouts = tuple(PackedLayout.of(record) for record in records)
        # Set while tracing, so that it is there before the first result.
        self._output_layouts[input_layouts] = output_layouts
        return tuple(layout.pack(record) for layout, record in zip(output_layouts, records, strict=True))
