"""Calls of a limit state within a budget: what they returned, what was undefined, and how many are left."""

from collections.abc import Callable

import numpy as np

from rpojax.analysis.reliability.rare_events.latent_points import LatentPoints, LatentSpace

_MANY = 0.05

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
        """What is to be known of points without a defined margin; nothing if there are none."""
        return (f"{self.undefined} points had no defined margin and count as failures",) if self.undefined else ()


def undefined_fault(margins: np.ndarray, weights: np.ndarray) -> list[str]:
    """What speaks against an estimate from weighted points of which those without a defined margin are many."""
    failed = margins <= 0.0
    share = float(weights[np.isneginf(margins)].sum() / max(weights[failed].sum(), 1e-300))
    return [f"{100.0 * share:.0f} % of the estimate are points without a defined margin"] if share > _MANY else []
