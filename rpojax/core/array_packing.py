"""Records of many small arrays as a few long ones: a compiled function's call costs by the array, whatever its size."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

_LARGE = 4096
"""Arrays with more numbers than that stay on their own, since packing copies them."""


class Layout:
    """Where each array of a record lies in the packed ones: one for every dtype, then the large ones as they are.

    There is one layout of a kind, so that it is compared by its identity: `of` makes them.
    """

    def __init__(self, tree: Any, shapes: tuple[tuple[int, ...], ...], dtypes: tuple[str, ...]) -> None:
        sizes = [int(np.prod(shape, dtype=np.int64)) for shape in shapes]
        self._tree, self._shapes = tree, shapes
        self._alone = [index for index, size in enumerate(sizes) if size > _LARGE]
        small = [index for index, size in enumerate(sizes) if size <= _LARGE]
        kinds = dict.fromkeys(dtypes[index] for index in small)
        self._groups = [[index for index in small if dtypes[index] == kind] for kind in kinds]
        ends = [np.cumsum([sizes[index] for index in group]).tolist() for group in self._groups]
        self._places = [
            [(index, end - sizes[index], end, shapes[index]) for index, end in zip(group, group_ends, strict=True)]
            for group, group_ends in zip(self._groups, ends, strict=True)
        ]

    @staticmethod
    def of(record: Any) -> "Layout":
        """Layout of a record of arrays."""
        leaves, tree = jax.tree.flatten(record)
        return _layout(tree, tuple(np.shape(leaf) for leaf in leaves), tuple(str(leaf.dtype) for leaf in leaves))

    def pack(self, record: Any, joined: Callable[[Sequence[Any]], Any] = jnp.concatenate) -> tuple[Any, ...]:
        """Packed arrays of a record."""
        leaves = jax.tree.leaves(record)
        parts = [joined([leaves[index].reshape(-1) for index in group]) for group in self._groups]
        return (*parts, *(leaves[index] for index in self._alone))

    def unpack(self, packed: Sequence[Any]) -> Any:
        """Record of packed arrays; of numpy's it holds views."""
        leaves: list[Any] = [None] * len(self._shapes)
        count = len(self._places)
        for array, places in zip(packed[:count], self._places, strict=True):
            for index, begin, end, shape in places:
                leaves[index] = array[begin:end].reshape(shape)
        for array, index in zip(packed[count:], self._alone, strict=True):
            leaves[index] = array
        return jax.tree.unflatten(self._tree, leaves)


@cache
def _layout(tree: Any, shapes: tuple[tuple[int, ...], ...], dtypes: tuple[str, ...]) -> Layout:
    return Layout(tree, shapes, dtypes)


@dataclass(frozen=True)
class Bundle:
    """A packed record."""

    layout: Layout
    arrays: tuple[Any, ...]

    @classmethod
    def of(cls, record: Any) -> "Bundle":
        """A record, packed on the host."""
        held = jax.tree.map(np.asarray, record)
        layout = Layout.of(held)
        return cls(layout, layout.pack(held, np.concatenate))

    def fetch(self) -> Any:
        """The record, with numpy's arrays."""
        return self.layout.unpack([np.asarray(array) for array in self.arrays])


class Packed:
    """A function of records that returns a tuple of records, compiled as a function of bundles."""

    def __init__(self, function: Callable[..., tuple[Any, ...]]) -> None:
        self._function = function
        self._layouts: dict[tuple[Layout, ...], tuple[Layout, ...]] = {}
        self._compiled = jax.jit(self._call, static_argnums=0)

    def __call__(self, *bundles: Bundle) -> tuple[Bundle, ...]:
        """The records that come of those given."""
        given = tuple(bundle.layout for bundle in bundles)
        results = self._compiled(given, *(bundle.arrays for bundle in bundles))
        return tuple(Bundle(*pair) for pair in zip(self._layouts[given], results, strict=True))

    def _call(self, given: tuple[Layout, ...], *packed: tuple[jax.Array, ...]) -> tuple[tuple[jax.Array, ...], ...]:
        records = self._function(*(layout.unpack(each) for layout, each in zip(given, packed, strict=True)))
        made = tuple(Layout.of(record) for record in records)
        # Known from the tracing on, which comes before the first result.
        self._layouts[given] = made
        return tuple(layout.pack(record) for layout, record in zip(made, records, strict=True))
