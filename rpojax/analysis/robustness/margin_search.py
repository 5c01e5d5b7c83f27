"""Search for margins: steps to one side of a quantity are doubled until one breaks, then bisected.

Steps are sizes in believed sigmas; all sides that still search are asked for one step at a time, so that the steps of a
round can be simulated together.
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
        broken: names of what breaks by the fraction of the runs, the worst first; empty where all holds
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
        """`farthest` is the size of the last step [sigmas]: beyond, the quantity has no meaning."""
        last = min(farthest, COARSE[-1])
        self._coarse = [size for size in COARSE if size < last] + [last]
        self.steps: dict[float, StepVerdict] = {}

    @property
    def breaks(self) -> float | None:
        """Least size that breaks; None without any."""
        return min((size for size, step in self.steps.items() if step.broken), default=None)

    @property
    def holds(self) -> float:
        """Greatest size below all that break; 0 without any."""
        breaks = self.breaks
        return max((size for size in self.steps if breaks is None or size < breaks), default=0.0)

    @property
    def requirement(self) -> str | None:
        """What breaks first; None where nothing does."""
        breaks = self.breaks
        return None if breaks is None else self.steps[breaks].broken[0]

    @property
    def interval(self) -> tuple[float | None, float | None]:
        """Greatest size below all that break that holds with confidence, and least that breaks with it."""
        low = [size for size, step in self.steps.items() if step.surely_holds and size <= self.holds]
        high = [size for size, step in self.steps.items() if step.surely_broken]
        return max(low, default=None), min(high, default=None)

    def next_size(self) -> float | None:
        """Size of the next step; None at the end."""
        if self.breaks is None:
            return next((size for size in self._coarse if size not in self.steps), None)
        found = self.breaks - self.holds > max(RESOLUTION * self.breaks, FINEST)
        return 0.5 * (self.breaks + self.holds) if found else None


def search(
    sides: Mapping[Side, SideSearch], evaluate: Callable[[Sequence[tuple[Side, float]]], Sequence[StepVerdict]]
) -> None:
    """Searches on all sides; `evaluate` gives the verdicts of a round of steps (side, size)."""
    while asked := [(side, size) for side, each in sides.items() if (size := each.next_size()) is not None]:
        for (side, size), verdict in zip(asked, evaluate(asked), strict=True):
            sides[side].steps[size] = verdict
