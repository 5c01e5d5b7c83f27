"""Kinds of outcome of a run, their codes and reasons; free of JAX."""

from enum import StrEnum
from typing import Final

import numpy as np


class Outcome(StrEnum):
    """How a run ended; where several apply, the first of those that freeze a run, of `RECOVERABLE`, or unfinished."""

    COMPLETED = "completed"
    NON_FINITE = "non_finite"
    KEEP_OUT = "keep_out"
    OUT_OF_PROPELLANT = "out_of_propellant"
    LOST = "lost"
    DIVERGED = "diverged"
    OFF_STATION = "off_station"
    ABORTED = "aborted"
    UNFINISHED = "unfinished"
    NOT_JUDGED = "not_judged"

    @property
    def code(self) -> int:
        """Number that is stored; the order of the members is that of the codes."""
        return list(Outcome).index(self)

    @property
    def is_failure(self) -> bool:
        """Whether it is neither success nor a run too short to be judged."""
        return self not in (Outcome.COMPLETED, Outcome.NOT_JUDGED)

    @property
    def reason(self) -> str:
        """The failure in words, empty without one."""
        return REASONS[self.code]


REASONS: Final = (
    "",
    "non-finite state",
    "entered the keep-out sphere",
    "out of propellant",
    "lost the target",
    "filter diverged",
    "off station",
    "aborted",
    "unfinished",
    "",
)
"""Reason of failure by code, empty for what is none."""

FREEZING: Final = (Outcome.NON_FINITE, Outcome.KEEP_OUT)
"""Outcomes that end a run at once, so that it has no metrics."""

RECOVERABLE: Final = (
    Outcome.OUT_OF_PROPELLANT,
    Outcome.ABORTED,
    Outcome.LOST,
    Outcome.DIVERGED,
    Outcome.OFF_STATION,
)
"""Outcomes that do not end a run and whose flag may be cleared again, by precedence."""


def of_codes(codes: np.ndarray) -> np.ndarray:
    """Outcomes (runs,) of stored codes (runs,), as text."""
    return np.array([str(kind) for kind in Outcome])[codes]


def is_frozen(outcomes: np.ndarray) -> np.ndarray:
    """Flags (runs,) of runs that ended before their time, from outcomes (runs,) as text."""
    return np.isin(outcomes, [str(kind) for kind in FREEZING])


def is_failed(outcomes: np.ndarray) -> np.ndarray:
    """Flags (runs,) of runs that failed, from outcomes (runs,) as text: neither completed nor not judged."""
    return np.isin(outcomes, [str(kind) for kind in Outcome if kind.is_failure])


def count_outcomes(outcomes: np.ndarray) -> dict[str, int]:
    """Number of runs by outcome, all of them, from outcomes (runs,) as text."""
    return {str(kind): int(np.sum(outcomes == kind)) for kind in Outcome}
