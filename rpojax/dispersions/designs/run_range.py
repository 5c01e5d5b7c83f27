"""Range of run numbers for which an experiment design is made."""

from dataclasses import dataclass
from typing import Any

from rpojax.errors import ResultError


@dataclass(frozen=True)
class RunRange:
    """Consecutive runs of a design.

    Attributes:
        first_run: number of the first run
        runs: number of runs
    """

    first_run: int
    runs: int


def recorded_run_range(recorded: Any, first_run: int, runs: int) -> RunRange:
    """Runs of the design of a recorded campaign with these runs, from the entry `design` of its `campaign.json`.

    Raises:
        ResultError: the record is missing or inconsistent.
    """
    numbers = [recorded.get(name) for name in ("first_run", "runs")] if isinstance(recorded, dict) else [None, None]
    first, count = numbers
    if type(first) is not int or type(count) is not int or first < 0 or count < 1:
        raise ResultError(f"campaign.json: found {recorded!r:.80} for 'design', expected first_run and runs")
    if first_run < first or first_run + runs > first + count:
        held = f"runs {first_run} to {first_run + runs - 1}"
        raise ResultError(f"campaign.json: found {held}, expected runs of its design, {first} to {first + count - 1}")
    return RunRange(first, count)
