"""One run of a campaign once more, as a campaign of its own, bit for bit at the recorded block size."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np

from rpojax.campaign import run_and_resume
from rpojax.campaign.execution import block_runner, executors
from rpojax.campaign.history_retention import Retention
from rpojax.campaign.storage import folder_creation
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import OutputError, RpojaxError
from rpojax.flight.computer import Stages


@dataclass(frozen=True)
class Rerun:
    """What came of it.

    Attributes:
        result: campaign of the one run, with its full history
        recorded: whether the first campaign holds the run, so that it could be compared
        different: metric -> (recorded, now), where they are not the same to the last bit
    """

    result: Campaign
    recorded: bool
    different: dict[str, tuple[float, float]]


def check_run(found: Campaign, run_id: int) -> None:
    """Refuses a run that a campaign does not have.

    Raises:
        RpojaxError: naming the runs that it has.
    """
    first, runs = found.asked["first_run"], found.asked["runs"]
    if not first <= run_id < first + runs:
        raise RpojaxError(f"--run-id: found {run_id}, expected a run of this campaign, {first} to {first + runs - 1}")


def rerun(
    found: Campaign,
    run_id: int,
    out: Path,
    *,
    force: bool = False,
    stages: Stages | None = None,
    on_progress: Callable[[run_and_resume.Progress], None] | None = None,
) -> Rerun:
    """Flies a run again, in a block of the size that the campaign had, and compares its metrics with those recorded.

    Raises:
        RpojaxError: there is no such run, the scenario or the stages are not those of the campaign, or the new folder
            cannot be used.
    """
    check_run(found, run_id)
    _check_apart(found.directory, out)
    engine = block_runner.engine_of(found.asked, jax.devices()[:1], stages)
    asked = {
        **found.asked,
        "runs": 1,
        "first_run": run_id,
        "histories": Retention("all").recorded(),
        "report": True,
        "rerun_of": {key: found.asked[key] for key in ("first_run", "runs")},
        **folder_creation.made_here(1),
    }
    folder_creation.create(out, asked, force)
    result = Campaign(out)
    run_and_resume.complete(result, executors.Local(result, engine), on_progress)
    rows = np.flatnonzero(found.run_ids == run_id)
    recorded = {name: float(values[rows[0]]) for name, values in found.metrics.items()} if len(rows) else {}
    return Rerun(result, len(rows) > 0, _different(recorded, result.metrics))


def _check_apart(source: Path, out: Path) -> None:
    """Refuses to make the new folder where the campaign itself is."""
    place, origin = Path(os.path.realpath(out)), Path(os.path.realpath(source))
    if place == origin or place in origin.parents:
        raise OutputError(f"--out: found {str(out)!r}, where the campaign itself is, expected another folder")


def _different(recorded: Mapping[str, float], now: Mapping[str, np.ndarray]) -> dict[str, tuple[float, float]]:
    pairs = {name: (value, float(now[name][0])) for name, value in recorded.items() if name in now}
    return {name: pair for name, pair in pairs.items() if not np.array_equal(*pair, equal_nan=True)}
