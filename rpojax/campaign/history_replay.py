"""Replay of one run of a campaign alone, for a full history that the campaign did not keep."""

import tempfile
from pathlib import Path

import numpy as np

from rpojax.campaign.run_and_resume import run_campaign
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.errors import RpojaxError
from rpojax.runtime.progress import ProgressCallback
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile


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
