"""Layout of a filter's state: named blocks of a vector, so that vectors and matrices are addressed by name."""

from dataclasses import dataclass
from functools import cached_property

import jax.numpy as jnp
from jaxtyping import Array, Float


@dataclass(frozen=True)
class StateLayout:
    """Named blocks of a state vector, in order.

    Attributes:
        blocks: name and size of each block
    """

    blocks: tuple[tuple[str, int], ...]

    @cached_property
    def _places(self) -> dict[str, slice]:
        places, start = {}, 0
        for name, size in self.blocks:
            places[name] = slice(start, start + size)
            start += size
        return places

    @property
    def size(self) -> int:
        """Length of the vector."""
        return sum(size for _, size in self.blocks)

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def __getitem__(self, name: str) -> slice:
        """Place of a block.

        Raises:
            KeyError: there is no block of that name.
        """
        return self._places[name]

    def places(self, name: str) -> range:
        """Indices of a block, for loops over its numbers."""
        return range(*self[name].indices(self.size))

    def after(self, name: str) -> "StateLayout":
        """Layout of the blocks that follow the named one."""
        first = [block for block, _ in self.blocks].index(name) + 1
        return StateLayout(self.blocks[first:])

    def split(self, vector: Array) -> dict[str, Array]:
        """Blocks of a vector (n,) by name."""
        return {name: vector[self[name]] for name, _ in self.blocks}

    def vector(self, **blocks: Array) -> Float[Array, " n"]:
        """Vector of the named blocks, zero in all others."""
        return jnp.concatenate(self._filled((), blocks), axis=0)

    def rows(self, **blocks: Array) -> Float[Array, "m n"]:
        """Rows (m, n) with the named columns (m, size), zero in all others."""
        count = next(iter(blocks.values())).shape[0]
        return jnp.concatenate(self._filled((count,), blocks), axis=1)

    def _filled(self, leading: tuple[int, ...], blocks: dict[str, Array]) -> list[Array]:
        if unknown := blocks.keys() - self._places.keys():
            raise KeyError(f"found {', '.join(sorted(unknown))}, expected names of blocks: {', '.join(self._places)}")
        dtype = next(iter(blocks.values())).dtype
        return [
            blocks[name] if name in blocks else jnp.zeros((*leading, size), dtype=dtype) for name, size in self.blocks
        ]


MOTION = StateLayout((("position", 3), ("velocity", 3)))
"""Layout of the motion of a body, with which the state of every orbit filter begins."""
