"""New campaign folders and synthetic blocks, without simulating anything."""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.storage import folder_creation
from rpojax.campaign.storage.campaign_folder import BlockTiming, Campaign
from rpojax.campaign.storage.provenance import new_configuration
from rpojax.scenario.schema import ScenarioFile

BLOCK_RUNS = 2
"""Runs of a synthetic block."""


def empty_campaign(
    directory: Path,
    file: ScenarioFile,
    seed: int,
    runs: int,
    first_run: int,
    block_size: int,
    history_ids: Sequence[int] = (),
    force: bool = False,
) -> Campaign:
    """A new campaign folder without finished blocks."""
    options = CampaignOptions(runs, seed, first_run, block_size, Retention.from_run_ids(history_ids))
    folder_creation.create_folder(directory, new_configuration(file, options), force)
    return Campaign(directory)


def synthetic_timing() -> BlockTiming:
    """Timing record of a synthetic block."""
    return BlockTiming(time.time(), 0.5, 0.0, "a test")


def synthetic_block(block: int) -> dict[str, np.ndarray]:
    """Arrays of one block, padding included; the second run has failed."""
    ids = np.arange(block * BLOCK_RUNS, (block + 1) * BLOCK_RUNS, dtype=float)
    return {
        "metrics/min_range_m": np.array([ids[0], np.nan]),
        "drawn/target.tumble_axis": np.stack([ids, -ids, 0.0 * ids], axis=1),
        "traces/range_m": np.array([[1.0, 2.0, 3.0], [1.0, np.nan, np.nan]], np.float32),
        "status/failure": np.array([0, 2], np.int8),
        "status/failed_at_s": np.array([np.nan, 12.0]),
    }
