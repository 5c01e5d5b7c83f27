"""Interface of executors, which have the blocks of a campaign simulated in this process, in others or on a cluster.

A block depends only on the campaign folder and its number, and its results are written into that folder. So an executor
only distributes block numbers, notices workers that die, and has their blocks repeated.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from rpojax.campaign.execution import block_runner
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.execution.selected_histories import SelectionSoFar
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError
from rpojax.runtime.thread_pools import thread_pool
from rpojax.scenario.plugins import plugin_registry

MAX_ATTEMPTS = 3
"""Number of workers that may die while simulating a block before it is given up."""

ExecutorProgressCallback = Callable[[float, int, bool], None]
"""Called with the runs done, fractions included, the runs failed so far, and whether programs are compiled."""


@runtime_checkable
class Executor(Protocol):
    """Simulates blocks of one campaign."""

    def run_blocks(self, blocks: Sequence[int], on_progress: ExecutorProgressCallback) -> dict[int, str]:
        """Simulates some blocks and stores them in the campaign folder; returns block -> reason for those given up.

        Raises:
            RpojaxError: an error that no repetition can avoid, such as a full disk.
        """
        ...


def check_default_stages(campaign: Campaign) -> None:
    """Refuses replaced stages, which cannot be sent to other processes.

    Raises:
        RpojaxError: a stage of the campaign is replaced.
    """
    plugin = plugin_registry.plugin_of(campaign.file)
    if campaign.file.plugin == plugin_registry.FROM_PYTHON:
        raise RpojaxError("metrics: found some from Python, expected a plugin file with other processes as workers")
    of_plugin = plugin is not None and plugin.stages is not None
    if (stages := campaign.configuration.stages) and not of_plugin:
        raise RpojaxError(f"stages: found {sorted(stages)} replaced, expected none with other processes as workers")


@dataclass(frozen=True)
class LocalExecutor:
    """Simulates one block per device at a time, while a thread stores the blocks before them.

    Attributes:
        campaign: where results are stored
        engine: compiled for the campaign's scenario
    """

    campaign: Campaign
    engine: BatchEngine

    def run_blocks(self, blocks: Sequence[int], on_progress: ExecutorProgressCallback) -> dict[int, str]:
        """Simulates and stores some blocks; no block is ever given up, since an error ends the process."""
        on_progress(0.0, 0, False)
        self.engine.compile()
        on_progress(0.0, 0, True)
        selection = SelectionSoFar.of_campaign(self.campaign)
        done, failed = 0, 0
        devices = len(self.engine.devices)
        with thread_pool(1) as pool:
            storing: Future[None] | None = None
            for first in range(0, len(blocks), devices):
                batch = blocks[first : first + devices]
                runs = sum(self.campaign.configuration.runs_in_block(block) for block in batch)
                on_batch_progress = _batch_progress(on_progress, runs, done, failed)
                results = block_runner.simulate_blocks(
                    self.campaign, self.engine, batch, on_batch_progress, any_history=selection is not None
                )
                if storing is not None:
                    storing.result()
                storing = pool.submit(block_runner.store_blocks, self.campaign, self.engine, results, selection)
                done, failed = done + runs, failed + results.failed_runs
            if storing is not None:
                storing.result()
        return {}


def _batch_progress(
    on_progress: ExecutorProgressCallback, runs: int, done: int, failed: int
) -> block_runner.BatchProgressCallback:
    """Progress of a batch of `runs` runs, added to the runs done and failed before it."""
    return lambda fraction, failures: on_progress(done + fraction * runs, failed + failures, True)
