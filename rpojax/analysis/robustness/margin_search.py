"""Search for margins: steps to one side of a quantity are doubled until one breaks, then bisected.

Step sizes are in believed sigmas. In each round every unfinished side asks for one step, so that the steps of a round
can be simulated together.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

COARSE: Final = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Sizes of the first steps [sigmas]."""
RESOLUTION: Final = 0.1
"""Distance between the last step that holds and the first that breaks, as a fraction of the latter."""
FINEST: Final = 0.0625
"""The least distance between them [sigmas]."""

Side = TypeVar("Side", bound=Hashable)


@dataclass(frozen=True)
class StepVerdict:
    """What the runs of a step say.

    Attributes:
        broken: names of the requirements that too many of the runs violate, the worst first; empty if there are none
        surely_broken: whether something breaks with confidence
        surely_holds: whether all holds with confidence
        record: further content, for a report
    """

    broken: tuple[str, ...]
    surely_broken: bool = False
    surely_holds: bool = False
    record: Mapping[str, Any] = field(default_factory=dict)


class SideSearch:
    """Steps to one side.

    Attributes:
        steps: verdicts by size [sigmas]
    """

    def __init__(self, farthest: float = COARSE[-1]) -> None:
        """`farthest` is the size of the last step [sigmas]: beyond it the quantity has no meaning."""
        last = min(farthest, COARSE[-1])
        self._coarse = [size for size in COARSE if size < last] + [last]
        self.steps: dict[float, StepVerdict] = {}

    @property
    def breaks(self) -> float | None:
        """Smallest size that breaks; None if none does."""
        return min((size for size, step in self.steps.items() if step.broken), default=None)

    @property
    def holds(self) -> float:
        """Largest size tried below every size that breaks; 0 if there is none."""
        breaks = self.breaks
        return max((size for size in self.steps if breaks is None or size < breaks), default=0.0)

    @property
    def requirement(self) -> str | None:
        """What breaks first; None where nothing does."""
        breaks = self.breaks
        return None if breaks is None else self.steps[breaks].broken[0]

    @property
    def interval(self) -> tuple[float | None, float | None]:
        """Largest size that surely holds, below every size that breaks, and smallest size that surely breaks."""
        low = [size for size, step in self.steps.items() if step.surely_holds and size <= self.holds]
        high = [size for size, step in self.steps.items() if step.surely_broken]
        return max(low, default=None), min(high, default=None)

    def next_size(self) -> float | None:
        """Size of the next step; None when the search is finished."""
        if self.breaks is None:
            return next((size for size in self._coarse if size not in self.steps), None)
        is_too_wide = self.breaks - self.holds > max(RESOLUTION * self.breaks, FINEST)
        return 0.5 * (self.breaks + self.holds) if is_too_wide else None


def search(
    sides: Mapping[Side, SideSearch], evaluate: Callable[[Sequence[tuple[Side, float]]], Sequence[StepVerdict]]
) -> None:
    """Searches on all sides; `evaluate` gives the verdicts of a round of steps (side, size)."""
    while asked := [(side, size) for side, each in sides.items() if (size := each.next_size()) is not None]:
        for (side, size), verdict in zip(asked, evaluate(asked), strict=True):
            sides[side].steps[size] = verdict
