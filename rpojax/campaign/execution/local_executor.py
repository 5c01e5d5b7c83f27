"""Executor that simulates blocks on all devices of this process."""

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass

from rpojax.campaign.execution import block_runner
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.execution.executor import ExecutorProgressCallback
from rpojax.campaign.execution.selected_histories import SelectionSoFar
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.runtime.thread_pools import thread_pool


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
