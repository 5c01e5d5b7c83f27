"""Records of many small arrays as a few long ones: a compiled function's call costs by the array, whatever its size."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

_LARGEST_PACKED_SIZE = 4096
"""Arrays with more numbers than that stay on their own, since packing copies them."""


class PackedLayout:
    """Where each array of a record lies in the packed ones: one for every dtype, then the large ones as they are.

    There is one layout of a kind, so that it is compared by its identity: `of` makes them.
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
        """Record of packed arrays; of numpy's it holds views."""
        leaves: list[Any] = [None] * len(self._shapes)
        count = len(self._slices)
        for array, places in zip(packed[:count], self._slices, strict=True):
            for index, begin, end, shape in places:
                leaves[index] = array[begin:end].reshape(shape)
        for array, index in zip(packed[count:], self._large, strict=True):
            leaves[index] = array
        return jax.tree.unflatten(self._tree, leaves)


@cache
def _layout(tree: Any, shapes: tuple[tuple[int, ...], ...], dtypes: tuple[str, ...]) -> PackedLayout:
    return PackedLayout(tree, shapes, dtypes)


@dataclass(frozen=True)
class PackedRecord:
    """A packed record."""

    layout: PackedLayout
    arrays: tuple[Any, ...]

    @classmethod
    def of(cls, record: Any) -> "PackedRecord":
        """A record, packed on the host."""
        held = jax.tree.map(np.asarray, record)
        layout = PackedLayout.of(held)
        return cls(layout, layout.pack(held, np.concatenate))

    def to_numpy(self) -> Any:
        """The record, with numpy's arrays."""
        return self.layout.unpack([np.asarray(array) for array in self.arrays])


class PackedFunction:
    """A function of records that returns a tuple of records, compiled as a function of bundles."""

    def __init__(self, function: Callable[..., tuple[Any, ...]]) -> None:
        self._function = function
        self._output_layouts: dict[tuple[PackedLayout, ...], tuple[PackedLayout, ...]] = {}
        self._compiled = jax.jit(self._call, static_argnums=0)

    def __call__(self, *bundles: PackedRecord) -> tuple[PackedRecord, ...]:
        """The records that come of those given."""
        input_layouts = tuple(bundle.layout for bundle in bundles)
        results = self._compiled(input_layouts, *(bundle.arrays for bundle in bundles))
        return tuple(PackedRecord(*pair) for pair in zip(self._output_layouts[input_layouts], results, strict=True))

    def _call(
        self, input_layouts: tuple[PackedLayout, ...], *packed: tuple[jax.Array, ...]
    ) -> tuple[tuple[jax.Array, ...], ...]:
        records = self._function(*(layout.unpack(each) for layout, each in zip(input_layouts, packed, strict=True)))
        output_layouts = tuple(PackedLayout.of(record) for record in records)
        # Known from the tracing on, which comes before the first result.
        self._output_layouts[input_layouts] = output_layouts
        return tuple(layout.pack(record) for layout, record in zip(output_layouts, records, strict=True))
