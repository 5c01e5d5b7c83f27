"""What a rule finds in runs: how strongly each shows a cause, since when, and the evidence in words."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from rpojax.analysis.failure_causes.run_evidence import Flags, Numbers

Words = Callable[[Flags], str]
"""Text about some of the runs (runs,)."""


class Depth(IntEnum):
    """How far back a cause lies: of two that a run shows, the one farther back is its cause."""

    EQUIPMENT = 0
    ROOT = 1
    MECHANISM = 2
    CONSEQUENCE = 3
    DECISION = 4


@dataclass(frozen=True)
class Finding:
    """A cause in runs.

    Attributes:
        name: of the cause
        title: in words, without numbers
        depth: how far back it lies
        strength: (runs,) measure over its threshold: from 1 on a run shows the cause
        at_s: (runs,) when it acted [s], NaN where unknown
        evidence: of some runs, with two numbers
        mend: what would mend it in some runs, empty if that is not known
        may_follow: whether it may also follow from the loss of the target: it is no cause of what came long before it
        is_loss: whether it is such a loss
    """

    name: str
    title: str
    depth: Depth
    strength: Numbers
    at_s: Numbers
    evidence: Words
    mend: Words
    may_follow: bool = False
    is_loss: bool = False

    @property
    def shown(self) -> Flags:
        """(runs,) whether a run shows the cause."""
        return np.asarray(self.strength >= 1.0)


def median(values: Numbers, chosen: Flags) -> float:
    """Median of the defined values (runs,) of some runs, NaN without one."""
    found = values[chosen & np.isfinite(values)]
    return float(np.median(found)) if len(found) else float("nan")


def percent(share: float) -> str:
    """Share as text; whole percents, no more than 99 for what is not all, no less than 1 for what is not nothing."""
    if not 0.0 < share < 1.0:
        return f"{100.0 * share:.0f} %"
    return f"{min(max(round(100.0 * share), 1), 99)} %"


def number(value: float) -> str:
    """Number with three digits."""
    return f"{value:.3g}" if abs(value) < 1e3 else f"{value:.0f}"


def no_words(_: Flags) -> str:
    """No text."""
    return ""
