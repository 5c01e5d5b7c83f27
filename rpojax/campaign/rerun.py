"""Rerun of one run of a campaign as a campaign of its own, equal to the last bit at the recorded block size."""

import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import jax
import numpy as np

from rpojax.campaign import run_and_resume
from rpojax.campaign.execution import campaign_engine
from rpojax.campaign.execution.executor import LocalExecutor
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.run_and_resume import run_campaign
from rpojax.campaign.storage import folder_creation, provenance
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import OutputError, RpojaxError
from rpojax.flight.stages import Stages
from rpojax.runtime.progress import ProgressCallback
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile


@dataclass(frozen=True)
class RerunResult:
    """A run that was simulated again, compared with the recorded one.

    Attributes:
        campaign: campaign of the one run, with its full history
        was_recorded: whether the original campaign holds the run, so that it could be compared
        differences: metric -> (recorded, rerun), for those that are not equal to the last bit
    """

    campaign: Campaign
    was_recorded: bool
    differences: dict[str, tuple[float, float]]


def check_run_id(campaign: Campaign, run_id: int) -> None:
    """Refuses a run number outside of a campaign.

    Raises:
        RpojaxError: naming the runs of the campaign.
    """
    first, runs = campaign.configuration.options.first_run, campaign.configuration.options.runs
    if not first <= run_id < first + runs:
        expected = f"a run of this campaign, {first} to {first + runs - 1}"
        raise RpojaxError.of_argument("run_id", f"found {run_id}, expected {expected}")


def rerun(
    campaign: Campaign,
    run_id: int,
    out: Path,
    *,
    force: bool = False,
    stages: Stages | None = None,
    on_progress: ProgressCallback | None = None,
) -> RerunResult:
    """Simulates a run again, in a block of the size that the campaign had, and compares its metrics with the recorded.

    Raises:
        RpojaxError: there is no such run, the scenario or the stages are not those of the campaign, or the new folder
            cannot be used.
    """
    check_run_id(campaign, run_id)
    _check_separate_folder(campaign.directory, out)
    engine = campaign_engine.recreate_engine(campaign.configuration, jax.devices()[:1], stages)
    options = campaign.configuration.options
    configuration = replace(
        campaign.configuration,
        options=replace(
            options,
            runs=1,
            first_run=run_id,
            histories=Retention("all"),
            run_range=options.design_range,
            report=True,
            until_decided=False,
            plan=None,
        ),
        rerun_of={"first_run": options.first_run, "runs": options.runs},
        **provenance.new_provenance(1),
    )
    folder_creation.create_folder(out, configuration, force)
    repeated = Campaign(out)
    run_and_resume.simulate_missing_blocks(repeated, LocalExecutor(repeated, engine), on_progress)
    rows = np.flatnonzero(campaign.run_ids == run_id)
    recorded = {name: float(values[rows[0]]) for name, values in campaign.metrics.items()} if len(rows) else {}
    return RerunResult(repeated, len(rows) > 0, _metric_differences(recorded, repeated.metrics))


def _check_separate_folder(source: Path, out: Path) -> None:
    """Refuses a new folder that is the campaign's own or contains it."""
    place, origin = Path(os.path.realpath(out)), Path(os.path.realpath(source))
    if place == origin or place in origin.parents:
        raise OutputError.of_argument(
            "out", f"found {str(out)!r}, where the campaign itself is, expected another folder"
        )


def _metric_differences(
    recorded: Mapping[str, float], repeated: Mapping[str, np.ndarray]
) -> dict[str, tuple[float, float]]:
    pairs = {name: (value, float(repeated[name][0])) for name, value in recorded.items() if name in repeated}
    return {name: pair for name, pair in pairs.items() if not np.array_equal(*pair, equal_nan=True)}


def replay_history(
    file: ScenarioFile,
    configuration: CampaignConfiguration,
    run_id: int,
    on_progress: ProgressCallback | None = None,
) -> dict[str, np.ndarray]:
    """Full history of a run, simulated again alone.

    A batch of another size rounds differently, so decisions at a threshold may differ from the run of the campaign,
    with a probability that grows with time.

    Raises:
        RpojaxError: stages of the flight software were replaced.
    """
    if (stages := configuration.stages) and plugin_registry.plugin_of(file) is None:
        raise RpojaxError(f"run {run_id}: found replaced stages {sorted(stages)}, expected a run with a kept history")
    with tempfile.TemporaryDirectory() as folder:
        campaign = run_campaign(
            file,
            1,
            Path(folder) / "run",
            configuration.options.seed,
            first_run=run_id,
            block_size=1,
            run_range=configuration.options.design_range,
            progress=False,
            on_progress=on_progress,
        )
        return campaign.history(run_id)
