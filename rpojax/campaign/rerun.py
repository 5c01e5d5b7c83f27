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
class RerunResult:
    """What came of it.

    Attributes:
        result: campaign of the one run, with its full history
        recorded: whether the first campaign holds the run, so that it could be compared
        different: metric -> (recorded, now), where they are not the same to the last bit
    """

    campaign: Campaign
    was_recorded: bool
    differences: dict[str, tuple[float, float]]


def check_run_id(campaign: Campaign, run_id: int) -> None:
    """Refuses a run that a campaign does not have.

    Raises:
        RpojaxError: naming the runs that it has.
    """
    first, runs = campaign.configuration["first_run"], campaign.configuration["runs"]
    if not first <= run_id < first + runs:
        raise RpojaxError(f"--run-id: found {run_id}, expected a run of this campaign, {first} to {first + runs - 1}")


def rerun(
    campaign: Campaign,
    run_id: int,
    out: Path,
    *,
    force: bool = False,
    stages: Stages | None = None,
    on_progress: Callable[[run_and_resume.Progress], None] | None = None,
) -> RerunResult:
    """Flies a run again, in a block of the size that the campaign had, and compares its metrics with those recorded.

    Raises:
        RpojaxError: there is no such run, the scenario or the stages are not those of the campaign, or the new folder
            cannot be used.
    """
    check_run_id(campaign, run_id)
    _check_separate_folder(campaign.directory, out)
    engine = block_runner.engine_from_configuration(campaign.configuration, jax.devices()[:1], stages)
    asked = {
        **campaign.configuration,
        "runs": 1,
        "first_run": run_id,
        "histories": Retention("all").to_record(),
        "report": True,
        "rerun_of": {key: campaign.configuration[key] for key in ("first_run", "runs")},
        **folder_creation.provenance(1),
    }
    folder_creation.create_folder(out, asked, force)
    result = Campaign(out)
    run_and_resume.simulate_missing_blocks(result, executors.LocalExecutor(result, engine), on_progress)
    rows = np.flatnonzero(campaign.run_ids == run_id)
    recorded = {name: float(values[rows[0]]) for name, values in campaign.metrics.items()} if len(rows) else {}
    return RerunResult(result, len(rows) > 0, _metric_differences(recorded, result.metrics))


def _check_separate_folder(source: Path, out: Path) -> None:
    """Refuses to make the new folder where the campaign itself is."""
    place, origin = Path(os.path.realpath(out)), Path(os.path.realpath(source))
    if place == origin or place in origin.parents:
        raise OutputError(f"--out: found {str(out)!r}, where the campaign itself is, expected another folder")


def _metric_differences(recorded: Mapping[str, float], now: Mapping[str, np.ndarray]) -> dict[str, tuple[float, float]]:
    pairs = {name: (value, float(now[name][0])) for name, value in recorded.items() if name in now}
    return {name: pair for name, pair in pairs.items() if not np.array_equal(*pair, equal_nan=True)}
