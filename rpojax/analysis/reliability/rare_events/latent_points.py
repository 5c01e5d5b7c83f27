"""Points at which a limit state is evaluated: standard normal numbers, and keys of the noise that is only redrawn."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

KEY_LIMIT = 2**32


@dataclass(frozen=True)
class LatentPoints:
    """Points of a limit state.

    Attributes:
        x: (n, k) standard normal numbers under the nominal distribution
        keys: (n, blocks) uint32 keys of the noise, one for each block that is redrawn at once; no columns without
    """

    x: np.ndarray
    keys: np.ndarray

    def __len__(self) -> int:
        return len(self.x)

    def rows(self, chosen: np.ndarray | slice) -> "LatentPoints":
        """Some of the points."""
        return LatentPoints(self.x[chosen], self.keys[chosen])

    def replaced(self, accepted: np.ndarray, other: "LatentPoints") -> "LatentPoints":
        """The points with those of `other` where `accepted` (n,)."""
        chosen = accepted[:, None]
        return LatentPoints(np.where(chosen, other.x, self.x), np.where(chosen, other.keys, self.keys))


def concatenated(parts: Sequence[LatentPoints]) -> LatentPoints:
    """Points of several parts in their order."""
    return LatentPoints(np.concatenate([part.x for part in parts]), np.concatenate([part.keys for part in parts]))


@dataclass(frozen=True)
class LatentSpace:
    """Space of the points of a limit state.

    Attributes:
        dimension: number of standard normal numbers, those of noise that is small enough to be moved included
        key_blocks: number of noise keys
        first_is_of_all: whether the first key is that of all noise whose own key is zero
    """

    dimension: int
    key_blocks: int
    first_is_of_all: bool = False

    def with_fresh_noise(self, rng: np.random.Generator, x: np.ndarray, in_blocks: bool = False) -> LatentPoints:
        """Points with given normal numbers (n, k) and new noise, `in_blocks` with a key for each block."""
        keys = rng.integers(1, KEY_LIMIT, (len(x), self.key_blocks), dtype=np.uint32)
        if self.first_is_of_all and not in_blocks:
            keys[:, 1:] = 0
        return LatentPoints(x, keys)

    def sample(self, rng: np.random.Generator, count: int, scale: float = 1.0, in_blocks: bool = False) -> LatentPoints:
        """Independent points of the nominal distribution, or of one whose normal numbers are `scale` times wider."""
        return self.with_fresh_noise(rng, scale * rng.standard_normal((count, self.dimension)), in_blocks)
