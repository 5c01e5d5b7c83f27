"""Points at which a limit state is evaluated: standard normal numbers, and keys of the noise that is only redrawn."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

KEY_LIMIT = 2**32
_MANY = 0.05


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


LimitFunction = Callable[[LatentPoints], np.ndarray]
"""Margins (n,) of points: failure at or below zero, NaN where undefined."""


class LimitStateCalls:
    """A limit state whose calls are counted.

    Attributes:
        space: of its points
        budget: most points to be evaluated
        used: points evaluated so far
        undefined: of them, those without a defined margin, which count as failures
    """

    def __init__(self, function: LimitFunction, space: LatentSpace, budget: int) -> None:
        self._function = function
        self.space, self.budget = space, budget
        self.used = self.undefined = 0

    @property
    def left(self) -> int:
        """Points that may still be evaluated."""
        return self.budget - self.used

    def margins(self, points: LatentPoints) -> np.ndarray:
        """Margins (n,) of points; minus infinity where undefined."""
        if len(points) > self.left:
            raise ValueError(f"points: found {len(points)}, expected at most the {self.left} left of the budget")
        if len(points) == 0:
            return np.zeros(0)
        found = np.asarray(self._function(points), dtype=np.float64)
        self.used += len(points)
        undefined = np.isnan(found)
        self.undefined += int(undefined.sum())
        return np.where(undefined, -np.inf, found)

    def undefined_remark(self) -> tuple[str, ...]:
        """Remark on points without a defined margin; empty if there are none."""
        return (f"{self.undefined} points had no defined margin and count as failures",) if self.undefined else ()


def undefined_fault(margins: np.ndarray, weights: np.ndarray) -> list[str]:
    """Warning about an estimate to which weighted points without a defined margin contribute much."""
    failed = margins <= 0.0
    share = float(weights[np.isneginf(margins)].sum() / max(weights[failed].sum(), 1e-300))
    return [f"{100.0 * share:.0f} % of the estimate are points without a defined margin"] if share > _MANY else []
