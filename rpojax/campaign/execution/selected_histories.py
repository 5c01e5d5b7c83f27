"""Histories of runs that are selected by their results, such as failures: simulated again once all blocks are done."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.execution.block_recording import thin_history
from rpojax.campaign.execution.block_runner import simulate_batch
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.metrics.metric_catalogue import metrics_of_scenario, worst_first
from rpojax.scenario.plugins import plugin_registry


def pending_histories(campaign: Campaign) -> list[int]:
    """Numbers of the runs whose history is to be kept for their results and is not stored yet.

    All blocks of the campaign must be finished.
    """
    retention = campaign.configuration.options.histories
    if not retention.depends_on_results:
        return []
    # The images of a rendered camera would all be rendered again.
    wanted = [] if campaign.file.camera.model == "rendered" else campaign.file.requirements
    required = [requirement.metric_name for requirement in wanted]
    with metrics_of_scenario(plugin_registry.metrics_of(campaign.file)):
        selected = selected_by_result(retention, campaign.run_ids, campaign.failed, campaign.metrics, required)
    return sorted(selected - set(campaign.history_ids))


def selected_by_result(
    retention: Retention,
    run_ids: np.ndarray,
    failed: np.ndarray,
    metrics: Mapping[str, np.ndarray],
    required: Sequence[str] = (),
) -> set[int]:
    """Numbers of the runs whose histories are kept because of their results.

    Args:
        retention: the rule
        run_ids: (runs,) run numbers
        failed: (runs,) whether the run failed
        metrics: name -> (runs,), nan if undefined
        required: metrics of the scenario's requirements
    """
    kept: set[int] = set(run_ids[failed].tolist()) if retention.keeps_failures else set()
    worst_kept = [(metric, 1) for metric in required] if retention.keeps_requirements else []
    for metric, count in (*retention.worst_kept, *worst_kept):
        kept.update(run_ids[worst_first(metric, metrics[metric])[:count]].tolist())
    return kept


def simulate_histories(
    campaign: Campaign, engine: BatchEngine, run_ids: Sequence[int], on_progress: Callable[[float], None]
) -> None:
    """Simulates some runs again, in batches of the campaign's block size, and stores their histories.

    `on_progress` is called with the number of finished runs, fractions of runs included.

    Raises:
        UnfinishedError: they cannot be stored.
    """
    options = campaign.configuration.options
    engine.compile()
    for first in range(0, len(run_ids), engine.capacity):
        batch_ids = list(run_ids[first : first + engine.capacity])
        padded_ids = np.array(batch_ids + [batch_ids[-1]] * (engine.capacity - len(batch_ids)))
        rows = np.arange(len(batch_ids))

        def on_batch_progress(fraction: float, _: int, first: int = first, count: int = len(batch_ids)) -> None:
            on_progress(first + fraction * count)

        batch = simulate_batch(
            engine, options.seed, padded_ids, rows.tolist(), rows, options.histories, on_batch_progress
        )
        for row, run_id in enumerate(batch_ids):
            history = thin_history(batch.history(row, engine), options.histories, engine.scenario.ticks)
            campaign.write_history(run_id, history)
