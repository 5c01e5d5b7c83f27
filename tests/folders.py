"""Campaign folders without an engine: what a campaign of some runs would begin with."""

import time
from collections.abc import Sequence
from pathlib import Path

from rpojax.campaign import creation
from rpojax.campaign.retention import Retention
from rpojax.campaign.store import Campaign, Effort
from rpojax.simulation.schema import ScenarioFile


def new_campaign(
    directory: Path,
    file: ScenarioFile,
    seed: int,
    runs: int,
    first_run: int,
    block_size: int,
    history_ids: Sequence[int] = (),
    force: bool = False,
) -> Campaign:
    """A new folder in which no block is done."""
    kept = Retention.of_runs(history_ids).recorded()
    creation.create(directory, creation.describe(file, seed, runs, first_run, block_size, kept), force)
    return Campaign(directory)


def effort() -> Effort:
    """A block that took no time."""
    return Effort(time.time(), 0.5, 0.0, "a test")
