"""Campaigns of dispersed runs: start a new one, resume an interrupted one, keep the histories selected by results."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax

from rpojax.campaign import (
    experiment_design,
    history_retention,
    preflight,
    replaced_stage_provenance,
    resource_estimates,
)
from rpojax.campaign.execution import batch_engine, campaign_engine, selected_histories
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.execution.executor import Executor
from rpojax.campaign.execution.local_executor import LocalExecutor
from rpojax.campaign.history_retention import Retention
from rpojax.campaign.job_shard import ALL_BLOCKS, Shard
from rpojax.campaign.storage import campaign_configuration, campaign_json, folder_creation, stale_files
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.flight.stages import Stages
from rpojax.runtime.progress_bar import Progress, ProgressCallback, run_progress
from rpojax.scenario.schema import ScenarioFile

DEFAULT_HISTORIES = 8
"""Number of runs, from the first, that keep a full history by default."""

ExecutorFactory = Callable[[Campaign], Executor]
"""Makes the executor of a campaign."""


def run_campaign(
    file: ScenarioFile,
    runs: int,
    out: Path | str,
    seed: int = 0,
    *,
    first_run: int = 0,
    block_size: int | None = None,
    histories: Sequence[int] | Retention | None = None,
    force: bool = False,
    devices: Sequence[Any] | None = None,
    stages: Stages | None = None,
    run_range: RunRange | None = None,
    progress: bool = True,
    on_progress: ProgressCallback | None = None,
    shard: Shard | None = None,
    executor: ExecutorFactory | None = None,
    report: bool = False,
) -> Campaign:
    """Simulates runs `first_run` to `first_run + runs - 1` of a scenario and stores them in a new folder.

    With a `shard` the folder may be one that other shards of the same campaign have made, and only the shard's blocks
    are simulated. By default the `executor` uses all devices of this process. `run_range` is the range of runs that
    the design is made for, if larger than this one. `report` records in the folder that a report is wanted.
    Progress is shown on stderr, or given to `on_progress`; with `progress=False` the call is silent.

    Raises:
        RpojaxError: a number is out of range, the folder cannot be used, or memory or disk are too small.
        UnfinishedError: the results cannot be written.
    """
    preflight.check_numbers(runs, first_run, seed, block_size)
    if shard is None:
        preflight.check_folder(Path(out), force)
    retention = _as_retention(histories, first_run, runs)
    retention.check_run_ids(first_run, runs)
    size = block_size or batch_engine.default_block_size(file)
    used_devices = _devices_for_blocks(devices, -(-runs // size))
    history_count = -(-retention.max_histories(first_run, runs) // retention.every)
    resource_estimates.check_resources(file, runs, size, len(used_devices), history_count, Path(out))
    design = experiment_design.make_design(file, seed, run_range or RunRange(first_run, runs))
    records = (retention.to_record(), replaced_stage_provenance.replaced_stages(stages or Stages()), design.record())
    engine = BatchEngine(file, size, used_devices, stages, design)
    configuration = campaign_configuration.new_configuration(
        file, seed, runs, first_run, size, *records, report, engine.batching
    )
    _check_channels(retention, engine)
    campaign = _open_folder(Path(out), configuration, force, shared=shard is not None)
    chosen = executor(campaign) if executor else LocalExecutor(campaign, engine)
    with _progress_display(on_progress, progress, file.duration_s) as report_progress:
        simulate_missing_blocks(campaign, chosen, report_progress, shard, stages)
    return campaign


def _as_retention(histories: Sequence[int] | Retention | None, first_run: int, runs: int) -> Retention:
    if isinstance(histories, Retention):
        return histories
    run_ids = range(first_run, first_run + min(runs, DEFAULT_HISTORIES)) if histories is None else histories
    return Retention.from_run_ids(run_ids)


def _devices_for_blocks(devices: Sequence[Any] | None, blocks: int) -> list[Any]:
    """As many of the devices as there are blocks."""
    return list(jax.devices() if devices is None else devices)[:blocks]


def _check_channels(retention: Retention, engine: BatchEngine) -> None:
    if retention.channels is not None:
        history_retention.check_channels(retention.channels, engine.channel_names())


def _open_folder(directory: Path, configuration: Mapping[str, Any], force: bool, shared: bool) -> Campaign:
    """Creates the folder of a campaign; a shared one may exist already."""
    if shared:
        folder_creation.join_folder(directory, configuration)
    else:
        folder_creation.create_folder(directory, configuration, force)
    return Campaign(directory)


def resume_campaign(
    directory: Path | str,
    *,
    stages: Stages | None = None,
    progress: bool = True,
    on_progress: ProgressCallback | None = None,
    shard: Shard | None = None,
    executor: ExecutorFactory | None = None,
) -> Campaign:
    """Simulates the missing blocks and histories of a campaign; a complete one is not changed.

    Progress is shown on stderr, or given to `on_progress`; with `progress=False` the call is silent.

    Raises:
        RpojaxError: the folder is no campaign, or `stages` are not those with which it began.
        UnfinishedError: the results cannot be written.
    """
    campaign = Campaign(directory)
    stale_files.remove_stale_files(campaign.directory)
    blocks = (shard or ALL_BLOCKS).select(campaign.missing_blocks())
    if blocks:
        replaced_stage_provenance.check_same_stages(campaign.configuration["stages"], stages or Stages())
        if executor is None:
            devices = _devices_for_blocks(None, len(blocks))
            engine = campaign_engine.recreate_engine(campaign.configuration, devices, stages)
            chosen: Executor = LocalExecutor(campaign, engine)
        else:
            chosen = executor(campaign)
        with _progress_display(on_progress, progress, campaign.file.duration_s) as report_progress:
            simulate_missing_blocks(campaign, chosen, report_progress, shard, stages)
    elif not campaign.missing_blocks() and selected_histories.pending_histories(campaign):
        with _progress_display(on_progress, progress, campaign.file.duration_s) as report_progress:
            _simulate_selected_histories(campaign, report_progress, stages)
    return campaign


@contextmanager
def _progress_display(
    on_progress: ProgressCallback | None, progress: bool, duration_s: float
) -> Iterator[ProgressCallback]:
    """The caller's own display of progress, or else one on stderr unless it is switched off."""
    if on_progress is not None:
        yield on_progress
    else:
        with run_progress(duration_s, quiet=not progress) as shown:
            yield shown


def is_complete(campaign: Campaign) -> bool:
    """Whether a campaign has all its blocks, and all histories that its results select."""
    return not campaign.missing_blocks() and not selected_histories.pending_histories(campaign)


def simulate_missing_blocks(
    campaign: Campaign,
    executor: Executor,
    on_progress: ProgressCallback | None = None,
    shard: Shard | None = None,
    stages: Stages | None = None,
) -> None:
    """Simulates the missing blocks of a campaign, and once none is missing the runs whose results select a history.

    Blocks that the executor gives up are recorded in `campaign.failed_blocks`.

    Raises:
        UnfinishedError: the results cannot be written.
    """
    blocks = (shard or ALL_BLOCKS).select(campaign.missing_blocks())
    report_progress = on_progress or _ignore_progress
    total = sum(campaign_json.runs_in_block(campaign.configuration, block) for block in blocks)

    def report_runs(done: float, failed: int, compiled: bool) -> None:
        report_progress(Progress(done=done, total=total, failed=failed, compiled=compiled))

    if blocks:
        campaign.failed_blocks.update(executor.run_blocks(blocks, report_runs))
    if not campaign.missing_blocks():
        engine = executor.engine if isinstance(executor, LocalExecutor) else None
        _simulate_selected_histories(campaign, report_progress, stages, engine)


def _simulate_selected_histories(
    campaign: Campaign, on_progress: ProgressCallback, stages: Stages | None, engine: BatchEngine | None = None
) -> None:
    """Stores the histories that depend on results, simulated with the engine of the blocks if it exists."""
    run_ids = selected_histories.pending_histories(campaign)
    if not run_ids:
        return
    total = len(run_ids)
    if engine is None:
        on_progress(Progress(done=0.0, total=total, failed=0, compiled=False))
        devices = _devices_for_blocks(None, -(-total // campaign.configuration["block_size"]))
        engine = campaign_engine.recreate_engine(campaign.configuration, devices, stages)

    def report_runs(done: float) -> None:
        on_progress(Progress(done=done, total=total, failed=0, compiled=True))

    selected_histories.simulate_histories(campaign, engine, run_ids, report_runs)


def _ignore_progress(_: Progress) -> None:
    pass
