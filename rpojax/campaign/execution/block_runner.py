"""Blocks of a campaign through the engine and into the folder; runs flown a second time for their histories."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.campaign import stage_provenance
from rpojax.campaign.execution import block_recording
from rpojax.campaign.execution.batch_engine import BatchEngine, PreparedRuns
from rpojax.campaign.execution.block_recording import ChannelRecorder
from rpojax.campaign.history_retention import Retention
from rpojax.campaign.storage import block_manifests, campaign_json, folder_creation
from rpojax.campaign.storage.campaign_folder import BlockTiming, Campaign
from rpojax.dispersions import designs
from rpojax.errors import RpojaxError
from rpojax.flight.computer import Stages
from rpojax.scenario import scenario_file

_REPRODUCIBILITY_PACKAGES = ("rpojax", "jax")
"""Packages that a run's last digits depend on."""

BatchProgressCallback = Callable[[float, int], None]
"""Told the share of a batch of runs that is done, and how many of them have failed."""


def engine_from_configuration(
    configuration: Mapping[str, Any], devices: Sequence[Any], stages: Stages | None = None
) -> BatchEngine:
    """The engine of a campaign that was begun, as its `campaign.json` asks for it.

    Raises:
        RpojaxError: the scenario, its trained files or the stages are not those of the campaign.
    """
    file = scenario_file.validate(configuration["scenario"])
    if scenario_file.digest(file) != configuration["scenario_hash"]:
        raise RpojaxError(
            "scenario: found another content or trained files, expected those that the campaign began with"
        )
    stage_provenance.check_same_stages(configuration["stages"], stages or Stages())
    return BatchEngine(file, configuration["block_size"], devices, stages, designs.recreate_design(file, configuration))


@dataclass(frozen=True)
class SimulatedBatch:
    """A batch of runs at their end.

    Attributes:
        block: the runs as they were prepared
        recorder: their channels
        failure: (runs,) code of failure
        failed_at: (runs,) [s]
    """

    prepared: PreparedRuns
    recorder: ChannelRecorder
    failure: np.ndarray
    failed_at: np.ndarray

    def history(self, row: int, engine: BatchEngine) -> dict[str, np.ndarray]:
        """Wanted channels of one run."""
        return self.recorder.history(row, engine.file, int(self.failure[row]), float(self.failed_at[row]))

    def block_arrays(self, rows: slice, engine: BatchEngine) -> dict[str, np.ndarray]:
        """Arrays of a block as they are stored."""
        return block_recording.block_arrays(
            engine.file, self.prepared, self.recorder, self.failure, self.failed_at, rows
        )


def simulate_batch(
    engine: BatchEngine,
    seed: int,
    run_ids: np.ndarray,
    history_rows: Sequence[int],
    unpadded_rows: np.ndarray,
    retention: Retention,
    on_progress: BatchProgressCallback,
) -> SimulatedBatch:
    """Carries `engine.capacity` runs to their end; `kept` rows have a history, `counted` ones are no padding."""
    block = engine.prepare(seed, run_ids)
    recorder = ChannelRecorder(engine.scenario.ticks, history_rows, retention.keeps_channel)
    last = None
    for number, segment in enumerate(engine.simulate(block)):
        recorder.add_segment(segment)
        last = segment
        on_progress((number + 1) / engine.segment_count, int((segment.failure[unpadded_rows] > 0).sum()))
    assert last is not None
    failure = np.where(last.failed_at < engine.file.duration_s, last.failure, 0)
    return SimulatedBatch(block, recorder, failure, last.failed_at)


def check_versions(recorded: Mapping[str, str]) -> None:
    """Refuses to add blocks with other packages than those that a campaign began with: their last digits may differ.

    Raises:
        RpojaxError: naming the package.
    """
    here = folder_creation.package_versions()
    for name in _REPRODUCIBILITY_PACKAGES:
        if recorded.get(name) != here[name]:
            raise RpojaxError(
                f"{name}: found version {here[name]}, expected {recorded.get(name)}, with which the campaign began"
            )


@dataclass(frozen=True)
class BlockResults:
    """Blocks that were flown at once, to be stored.

    Attributes:
        blocks: their numbers
        flown: their runs, padded to a full batch
        effort: what they took
        kept: rows that have a history
        failures: how many of their runs failed
    """

    blocks: Sequence[int]
    batch: SimulatedBatch
    timing: BlockTiming
    history_rows: Sequence[int]
    failed_runs: int


def simulate_and_store(
    campaign: Campaign, engine: BatchEngine, blocks: Sequence[int], on_progress: BatchProgressCallback
) -> int:
    """Flies some blocks at once, one a device, and stores them; returns how many of their runs failed.

    Raises:
        UnfinishedError: they cannot be stored.
    """
    landed = simulate_blocks(campaign, engine, blocks, on_progress)
    store_blocks(campaign, engine, landed)
    return landed.failed_runs


def simulate_blocks(
    campaign: Campaign, engine: BatchEngine, blocks: Sequence[int], on_progress: BatchProgressCallback
) -> BlockResults:
    """Flies some blocks at once, one a device."""
    check_versions(campaign.configuration["versions"])
    engine.compile()
    for block in blocks:
        block_manifests.record_attempt(campaign.directory, block)
    began_s = time.time()
    # A device without a block of its own repeats the last one: shapes, and so the program, stay the same.
    padded = [*blocks, *[blocks[-1]] * (len(engine.devices) - len(blocks))]
    ids = np.concatenate([campaign.block_run_ids(block) for block in padded])
    size, retention = engine.runs_per_device, Retention.from_record(campaign.configuration["histories"])
    counts = [campaign_json.runs_in_block(campaign.configuration, block) for block in blocks]
    counted = np.concatenate([np.arange(count) + place * size for place, count in enumerate(counts)])
    known = retention.unconditional_run_ids(campaign.configuration["first_run"], campaign.configuration["runs"])
    kept = [row for row in counted.tolist() if int(ids[row]) in known]
    flown = simulate_batch(engine, campaign.configuration["seed"], ids, kept, counted, retention, on_progress)
    # Storing is left out: meanwhile the next blocks are flown.
    wall_s = max(0.0, time.time() - began_s)
    effort = BlockTiming(began_s, wall_s, engine.compile_s, folder_creation.device_description(len(engine.devices)))
    return BlockResults(blocks, flown, effort, kept, int((flown.failure[counted] > 0).sum()))


def store_blocks(campaign: Campaign, engine: BatchEngine, results: BlockResults) -> None:
    """Stores blocks that were flown.

    Raises:
        UnfinishedError: they cannot be stored.
    """
    size, retention, flown = (
        engine.runs_per_device,
        Retention.from_record(campaign.configuration["histories"]),
        results.batch,
    )
    for place, block in enumerate(results.blocks):
        rows = slice(place * size, place * size + size)
        for row in results.history_rows:
            if rows.start <= row < rows.stop:
                history = retention.thin(flown.history(row, engine), engine.scenario.ticks)
                campaign.write_history(int(flown.prepared.run_ids[row]), history)
        campaign.write_block(block, flown.block_arrays(rows, engine), results.timing)


def pending_histories(campaign: Campaign) -> list[int]:
    """Runs whose history is to be kept for what became of them, and is not there yet; once all blocks are done."""
    retention = Retention.from_record(campaign.configuration["histories"])
    if not retention.depends_on_results:
        return []
    return sorted(
        retention.selected_by_result(campaign.run_ids, campaign.completed, campaign.metrics) - set(campaign.history_ids)
    )


def simulate_histories(
    campaign: Campaign, engine: BatchEngine, run_ids: Sequence[int], on_progress: Callable[[float], None]
) -> None:
    """Flies some runs a second time, in blocks of the size of the first, and stores their histories.

    Raises:
        UnfinishedError: they cannot be stored.
    """
    retention = Retention.from_record(campaign.configuration["histories"])
    engine.compile()
    for first in range(0, len(run_ids), engine.capacity):
        batch = list(run_ids[first : first + engine.capacity])
        ids = np.array(batch + [batch[-1]] * (engine.capacity - len(batch)))
        rows = np.arange(len(batch))

        def during(share: float, _: int, first: int = first, count: int = len(batch)) -> None:
            on_progress(first + share * count)

        flown = simulate_batch(engine, campaign.configuration["seed"], ids, rows.tolist(), rows, retention, during)
        for row, run_id in enumerate(batch):
            campaign.write_history(run_id, retention.thin(flown.history(row, engine), engine.scenario.ticks))
