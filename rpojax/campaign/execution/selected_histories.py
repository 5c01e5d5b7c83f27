"""Histories of runs that are selected by their results, such as failures: simulated again once all blocks are done."""

from collections.abc import Callable, Sequence

import numpy as np

from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.execution.block_runner import simulate_batch
from rpojax.campaign.history_retention import Retention
from rpojax.campaign.storage.campaign_folder import Campaign


def pending_histories(campaign: Campaign) -> list[int]:
    """Numbers of the runs whose history is to be kept for their results and is not stored yet.

    All blocks of the campaign must be finished.
    """
    retention = Retention.from_record(campaign.configuration["histories"])
    if not retention.depends_on_results:
        return []
    selected = retention.selected_by_result(campaign.run_ids, campaign.completed, campaign.metrics)
    return sorted(selected - set(campaign.history_ids))


def simulate_histories(
    campaign: Campaign, engine: BatchEngine, run_ids: Sequence[int], on_progress: Callable[[float], None]
) -> None:
    """Simulates some runs again, in batches of the campaign's block size, and stores their histories.

    `on_progress` is called with the number of finished runs, fractions of runs included.

    Raises:
        UnfinishedError: they cannot be stored.
    """
    retention = Retention.from_record(campaign.configuration["histories"])
    engine.compile()
    for first in range(0, len(run_ids), engine.capacity):
        batch_ids = list(run_ids[first : first + engine.capacity])
        padded_ids = np.array(batch_ids + [batch_ids[-1]] * (engine.capacity - len(batch_ids)))
        rows = np.arange(len(batch_ids))

        def on_batch_progress(fraction: float, _: int, first: int = first, count: int = len(batch_ids)) -> None:
            on_progress(first + fraction * count)

        batch = simulate_batch(
            engine, campaign.configuration["seed"], padded_ids, rows.tolist(), rows, retention, on_batch_progress
        )
        for row, run_id in enumerate(batch_ids):
            campaign.write_history(run_id, retention.thin(batch.history(row, engine), engine.scenario.ticks))
