"""Simulation of blocks of a campaign, one per device at a time, and storing of their results in the campaign folder."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rpojax.campaign.execution import block_recording, team_passive_safety, teams
from rpojax.campaign.execution.batch_engine import BatchEngine, PreparedRuns, Segment
from rpojax.campaign.execution.block_recording import ChannelRecorder, ServicerResults, recorded_channels
from rpojax.campaign.execution.campaign_engine import check_versions
from rpojax.campaign.execution.selected_histories import SelectionSoFar
from rpojax.campaign.execution.surface_coverage import CoverageResults
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.storage import block_manifests
from rpojax.campaign.storage.campaign_folder import BlockTiming, Campaign
from rpojax.campaign.storage.provenance import device_description
from rpojax.metrics import metric_catalogue
from rpojax.runtime.rows_in_parts import in_parts
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics import team_metrics
from rpojax.simulation.outcomes import outcome_kinds, team_outcome
from rpojax.simulation.outcomes.judgement import JudgedRuns, judge
from rpojax.simulation.outcomes.outcome_events import EventArrays

BatchProgressCallback = Callable[[float, int], None]
"""Called with the finished fraction of a batch of runs, and with the number of its runs that have failed."""


@dataclass(frozen=True)
class SimulatedBatch:
    """A batch of runs after simulation.

    Attributes:
        prepared: the runs at their initial states
        recorder: their channels
        servicers: what was judged of each servicer
        judged: how the runs ended: as the worst of their servicers did
        between: metrics of the free drifts of servicers from each other
    """

    prepared: PreparedRuns
    recorder: ChannelRecorder
    servicers: Sequence[ServicerResults]
    judged: JudgedRuns
    between: Mapping[str, np.ndarray]

    def history(self, row: int, engine: BatchEngine) -> dict[str, np.ndarray]:
        """Kept channels of one run, with the servicers of a team along the second axis."""
        histories = []
        for number, own in enumerate(self.servicers):
            frozen_at_s = float(own.judged.since_s[row]) if own.judged.frozen[row] else np.inf
            servicer = number if engine.file.servicers else None
            histories.append(self.recorder.history(row, own.file, own.used, frozen_at_s, servicer))
        return teams.joined_history(histories) if engine.file.servicers else histories[0]

    def block_arrays(self, rows: slice, engine: BatchEngine) -> dict[str, np.ndarray]:
        """Arrays of one block as they are stored."""
        arrays = [block_recording.servicer_arrays(own, rows) for own in self.servicers]
        if not engine.file.servicers:
            return arrays[0] | block_recording.value_arrays(self.prepared, rows)
        coverage = engine.coverage.union([own.coverage for own in self.servicers])
        recorded = self.recorder.records_of_runs(rows)
        of_team = {**coverage.metrics, **self.between}
        metrics = {name: values[rows] for name, values in of_team.items()}
        metrics |= team_metrics.evaluate(1.0 / engine.file.rates.camera_hz, recorded)
        with metric_catalogue.metrics_of_scenario(plugin_registry.metrics_of(engine.file)):
            joined = teams.joined_arrays(arrays, metrics, coverage.maps, self.judged, rows)
        return joined | teams.value_arrays(engine.file, block_recording.value_arrays(self.prepared, rows))


def simulate_batch(
    engine: BatchEngine,
    seed: int,
    run_ids: np.ndarray,
    history_rows: Sequence[int],
    unpadded_rows: np.ndarray,
    retention: Retention,
    on_progress: BatchProgressCallback,
    *,
    drifts: bool = True,
    spool: Path | None = None,
    assigned: Mapping[str, np.ndarray] | None = None,
) -> SimulatedBatch:
    """Simulates `engine.capacity` runs to their end.

    Args:
        engine: compiled for the scenario
        seed: master seed
        run_ids: (capacity,) run numbers
        history_rows: rows of the runs that may keep a history
        unpadded_rows: rows of the runs that are no padding, or a mask of them
        retention: which channels are kept
        on_progress: called after every segment
        drifts: whether free drifts and coverage are evaluated, which histories do without
        spool: folder for a file of channels that exceed the memory for histories
        assigned: rows (capacity, ...) in place of what the design assigns to the runs' numbers
    """
    prepared = engine.prepare(seed, run_ids, assigned)
    recorder = ChannelRecorder(
        engine.scenario.ticks, history_rows, retention.keeps_channel, recorded_channels(engine.file), spool
    )
    last = None
    for number, segment in enumerate(engine.simulate(prepared)):
        recorder.add_segment(segment)
        last = segment
        on_progress((number + 1) / engine.segment_count, int(_failures(segment)[unpadded_rows].sum()))
    assert last is not None
    failure = np.where(last.failed_at < engine.file.duration_s, last.failure, 0)
    ended = failure, last.failed_at
    servicers = [_judged(engine, prepared, recorder, number, *ended, drifts) for number in _numbers(engine)]
    if not engine.file.servicers:
        return SimulatedBatch(prepared, recorder, servicers, servicers[0].judged, {})
    worst = team_outcome.worst([own.judged for own in servicers])
    if not drifts:
        return SimulatedBatch(prepared, recorder, servicers, worst, {})
    drawn = [teams.of_member(engine.file, prepared.drawn, number) for number in _numbers(engine)]
    between = team_passive_safety.least_separation(engine.passive_safety, engine.member_params, drawn, recorder.records)
    return SimulatedBatch(prepared, recorder, servicers, worst, between)


def _failures(segment: Segment) -> np.ndarray:
    """Flags (runs,) of runs of which something was frozen."""
    return np.asarray(segment.failure.reshape(-1, segment.failure.shape[-1]).any(axis=0))


def _numbers(engine: BatchEngine) -> Sequence[int]:
    return range(len(engine.members))


def _judged(
    engine: BatchEngine,
    prepared: PreparedRuns,
    recorder: ChannelRecorder,
    number: int,
    failure: np.ndarray,
    failed_at: np.ndarray,
    drifts: bool,
) -> ServicerResults:
    """What is judged of one servicer."""
    file, nominal, is_team = engine.members[number], engine.member_params[number], bool(engine.file.servicers)
    drawn, used = (teams.of_member(engine.file, values, number) for values in (prepared.drawn, prepared.used))
    # The servicers of a team are the axis before the runs.
    channels = {name: each[..., number, :] if is_team else each for name, each in recorder.records.items()}
    records = {name: np.moveaxis(values, -1, 0) for name, values in channels.items()}
    own_failure, own_failed_at = (failure[number], failed_at[number]) if is_team else (failure, failed_at)
    values_of_drifts = team_passive_safety.with_target(engine.scenario.effects, drawn, nominal) if is_team else drawn
    return ServicerResults(
        file=file,
        used=used,
        records=records,
        passive_safety=engine.passive_safety.evaluate(values_of_drifts, channels, nominal) if drifts else {},
        coverage=engine.coverage.evaluate(drawn, channels, nominal) if drifts else CoverageResults({}, {}),
        judged=_judged_runs(file, used, records, own_failure, own_failed_at),
    )


def _judged_runs(
    file: ScenarioFile,
    used: Mapping[str, np.ndarray],
    records: Mapping[str, np.ndarray],
    failure: np.ndarray,
    failed_at_s: np.ndarray,
) -> JudgedRuns:
    """As `judge`, for any number of runs at once."""

    def judged(rows: slice) -> dict[str, np.ndarray]:
        own_used = {key: values[rows] for key, values in used.items()}
        own_records = {name: values[rows] for name, values in records.items()}
        found = judge(file, own_used, own_records, failure[rows], failed_at_s[rows])
        return {"codes": found.codes, "since_s": found.since_s, **found.events.stored(slice(None))}

    found = in_parts(judged, slice(0, len(failure)))
    return JudgedRuns(found.pop("codes"), found.pop("since_s"), EventArrays(**found))


@dataclass(frozen=True)
class BlockResults:
    """Blocks that were simulated at once, to be stored.

    Attributes:
        blocks: their numbers
        batch: their runs, padded to the capacity of the engine
        timing: computation time of each
        failed_runs: number of their runs that failed
    """

    blocks: Sequence[int]
    batch: SimulatedBatch
    timing: BlockTiming
    failed_runs: int


def simulate_and_store(
    campaign: Campaign, engine: BatchEngine, blocks: Sequence[int], on_progress: BatchProgressCallback
) -> int:
    """Simulates some blocks at once, one per device, and stores them; returns the number of runs that failed.

    Raises:
        UnfinishedError: they cannot be stored.
    """
    results = simulate_blocks(campaign, engine, blocks, on_progress)
    store_blocks(campaign, engine, results)
    return results.failed_runs


def simulate_blocks(
    campaign: Campaign,
    engine: BatchEngine,
    blocks: Sequence[int],
    on_progress: BatchProgressCallback,
    *,
    any_history: bool = False,
) -> BlockResults:
    """Simulates some blocks at once, one per device; with `any_history` each of their runs may keep its history."""
    options = campaign.configuration.options
    check_versions(campaign.configuration.versions)
    engine.compile()
    for block in blocks:
        block_manifests.record_attempt(campaign.directory, block)
    began_s = time.time()
    # A device without a block of its own repeats the last one, so that shapes and thereby programs stay the same.
    padded = [*blocks, *[blocks[-1]] * (len(engine.devices) - len(blocks))]
    run_ids = np.concatenate([campaign.block_run_ids(block) for block in padded])
    unpadded_rows = _unpadded_rows(campaign, engine, blocks)
    kept_run_ids = options.histories.unconditional_run_ids(options.first_run, options.runs)
    history_rows = [row for row in unpadded_rows.tolist() if any_history or int(run_ids[row]) in kept_run_ids]
    batch = simulate_batch(
        *(engine, options.seed, run_ids, history_rows, unpadded_rows, options.histories, on_progress),
        spool=campaign.directory,
    )
    # Without the time to store, which overlaps with the simulation of the next blocks.
    wall_s = max(0.0, time.time() - began_s)
    timing = BlockTiming(began_s, wall_s, engine.compile_s, device_description(len(engine.devices)))
    return BlockResults(blocks, batch, timing, int(batch.judged.failed[unpadded_rows].sum()))


def _unpadded_rows(campaign: Campaign, engine: BatchEngine, blocks: Sequence[int]) -> np.ndarray:
    """Rows of a batch that hold runs of the campaign."""
    counts = [campaign.configuration.runs_in_block(block) for block in blocks]
    return np.concatenate([np.arange(count) + place * engine.runs_per_device for place, count in enumerate(counts)])


def store_blocks(
    campaign: Campaign, engine: BatchEngine, results: BlockResults, selection: SelectionSoFar | None = None
) -> None:
    """Stores simulated blocks in the campaign folder.

    With the `selection` of the blocks before, histories of the runs that it selects among these are stored, too, and
    those of runs that it selects no more are removed.

    Raises:
        UnfinishedError: they cannot be stored.
    """
    size, batch = engine.runs_per_device, results.batch
    if engine.file.coverage.enabled:
        campaign.write_surface(engine.coverage.facets.arrays())
    options = campaign.configuration.options
    unconditional = options.histories.unconditional_run_ids(options.first_run, options.runs)
    for place, block in enumerate(results.blocks):
        rows = slice(place * size, place * size + size)
        arrays = batch.block_arrays(rows, engine)
        count = campaign.configuration.runs_in_block(block)
        run_ids = batch.prepared.run_ids[rows][:count]
        kept, displaced = set(unconditional), set[int]()
        if selection is not None:
            failed = outcome_kinds.is_failed(outcome_kinds.of_codes(arrays["status/failure"][:count]))
            metrics = _metrics(arrays, campaign.servicer_names)
            with metric_catalogue.metrics_of_scenario(plugin_registry.metrics_of(engine.file)):
                displaced = selection.add(run_ids, failed, {name: values[:count] for name, values in metrics.items()})
            kept.update(selection.run_ids.tolist())
        for row, run_id in enumerate(run_ids.tolist(), start=rows.start):
            if run_id in kept:
                history = block_recording.thin_history(
                    batch.history(row, engine), options.histories, engine.scenario.ticks
                )
                campaign.write_history(run_id, history)
        with metric_catalogue.metrics_of_scenario(plugin_registry.metrics_of(engine.file)):
            campaign.write_block(block, arrays, results.timing)
        for run_id in displaced - unconditional:
            campaign.remove_history(run_id)


def _metrics(arrays: Mapping[str, np.ndarray], servicers: Sequence[str]) -> dict[str, np.ndarray]:
    """Metrics among the arrays of a block, as `Campaign.metrics` names them."""
    metrics: dict[str, np.ndarray] = {}
    for path, values in arrays.items():
        group, _, name = path.partition("/")
        if group == "metrics":
            metrics[name] = values
        elif group == "servicer_metrics":
            metrics |= {f"{name}/{servicer}": values[:, number] for number, servicer in enumerate(servicers)}
    return metrics


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
            *(engine, options.seed, padded_ids, rows.tolist(), rows, options.histories, on_batch_progress),
            drifts=False,
            spool=campaign.directory,
        )
        for row, run_id in enumerate(batch_ids):
            history = block_recording.thin_history(batch.history(row, engine), options.histories, engine.scenario.ticks)
            campaign.write_history(run_id, history)
