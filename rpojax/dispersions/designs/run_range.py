"""Range of run numbers for which an experiment design is made."""

from collections.abc import Mapping
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


def recorded_run_range(configuration: Mapping[str, Any]) -> RunRange:
    """Runs of the design of a recorded campaign, from the content of its `campaign.json`.

    Raises:
        ResultError: the record is missing or inconsistent.
    """
    info = configuration
    recorded = info.get("design", {"first_run": info["first_run"], "runs": info["runs"]})
    numbers = [recorded.get(name) for name in ("first_run", "runs")] if isinstance(recorded, dict) else [None, None]
    first, runs = numbers
    if type(first) is not int or type(runs) is not int or first < 0 or runs < 1:
        raise ResultError(f"campaign.json: found {recorded!r:.80} for 'design', expected first_run and runs")
    if info["first_run"] < first or info["first_run"] + info["runs"] > first + runs:
        held = f"runs {info['first_run']} to {info['first_run'] + info['runs'] - 1}"
        raise ResultError(f"campaign.json: found {held}, expected runs of its design, {first} to {first + runs - 1}")
    return RunRange(first, runs)
