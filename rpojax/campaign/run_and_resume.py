"""Campaigns of dispersed runs: start a new one, resume an interrupted one, keep the histories selected by results."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import jax
import jax.numpy as jnp

from rpojax.campaign import argument_checks, experiment_design, resource_estimates, sequential_looks
from rpojax.campaign.execution import block_runner, campaign_engine, selected_histories
from rpojax.campaign.execution.batch_engine import BatchEngine, default_block_size, fitted_block_size
from rpojax.campaign.execution.executor import Executor, LocalExecutor
from rpojax.campaign.options import history_retention
from rpojax.campaign.options.campaign_options import (
    ALL_BLOCKS,
    DEFAULT_HISTORIES,
    CampaignOptions,
    FurtherOptions,
    Shard,
)
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.storage import block_manifests, folder_creation, lost_results, provenance
from rpojax.campaign.storage.arrays.array_files import LostFile
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError
from rpojax.flight.stages import Stages
from rpojax.metrics.metric_catalogue import METRICS
from rpojax.runtime import programs_per_device
from rpojax.runtime.progress import Progress, ProgressCallback, run_progress
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.plugins.custom_metrics import MetricFunction, unknown_channel
from rpojax.scenario.plugins.plugin import Plugin
from rpojax.scenario.schema import ScenarioFile

_ALWAYS = ("time_s", "rho_desired_H")
"""Channels that are no telemetry in every scenario."""
ExecutorFactory = Callable[[Campaign], Executor]
"""Makes the executor of a campaign."""


def check_metrics(file: ScenarioFile, engine: BatchEngine, histories: Retention) -> None:
    """Refuses metrics of channels that the scenario does not have, and of ticks that give no number.

    Raises:
        RpojaxError: naming the metric, what was found and what was expected.
    """
    own = plugin_registry.metrics_of(file)
    for name, _ in histories.worst_kept:
        if name not in own and name not in METRICS:
            raise RpojaxError.of_argument("histories", f"found metric {name!r}, expected one of the campaign")
    if not own:
        return
    shapes = engine.channel_shapes()
    for metric in own.values():
        for channel in metric.inputs:
            if channel not in shapes and channel not in _ALWAYS:
                raise unknown_channel(metric.name, channel, (*shapes, *_ALWAYS))
        if not callable(metric.reduction):
            example = {"time_s": jax.ShapeDtypeStruct((), jnp.float64)}
            example |= {"rho_desired_H": jax.ShapeDtypeStruct((3,), jnp.float64), **shapes}
            jax.eval_shape(lambda *values, m=metric: m.value(jnp, *values), *(example[name] for name in metric.inputs))


@dataclass(frozen=True)
class Execution:
    """How the blocks of a campaign are simulated; results do not depend on it, except for replaced stages.

    Attributes:
        devices: of this process, by default all
        stages: of the flight software, replaced ones included
        shard: simulates only its blocks, in a folder that other shards of the same campaign may have made
        executor: by default one that uses the devices of this process
    """

    devices: Sequence[Any] | None = None
    stages: Stages | None = None
    shard: Shard | None = None
    executor: ExecutorFactory | None = None


def run_campaign(
    file: ScenarioFile,
    runs: int,
    out: Path | str,
    seed: int = 0,
    *,
    histories: Sequence[int] | str | Retention | None = None,
    force: bool = False,
    devices: Sequence[Any] | None = None,
    stages: Stages | None = None,
    metrics: Mapping[str, MetricFunction] | None = None,
    progress: bool = True,
    on_progress: ProgressCallback | None = None,
    shard: Shard | None = None,
    executor: ExecutorFactory | None = None,
    **further: Unpack[FurtherOptions],
) -> Campaign:
    """Simulates runs of a scenario and stores them in a new folder.

    Args:
        file: the scenario
        runs: number of runs; with `until_decided` the most
        out: folder to make
        seed: master seed
        histories: run numbers, or the rule as of the command, of the runs that keep a history; by default the first
            eight and the worst one of each requirement
        force: replace the folder if it holds a campaign
        devices: of this process, by default all
        stages: of the flight software, replaced ones included
        metrics: functions of channels by the name of the metric (docs/how_to/plugins.md)
        progress: show progress on stderr
        on_progress: shows the progress instead
        shard: simulates only its blocks, in a folder that other shards of the same campaign may have made
        executor: by default one that uses the devices of this process
        further: `first_run`, `block_size`, `run_range`, `report` and `until_decided` of `CampaignOptions`

    Raises:
        RpojaxError: a number is out of range, the folder cannot be used, or memory or disk are too small.
        UnfinishedError: the results cannot be written.
    """
    file = scenario_loader.with_metrics(file, metrics)
    options = CampaignOptions(runs=runs, seed=seed, histories=_as_retention(histories), **further)
    execution = Execution(devices, stages, shard, executor)
    with _progress_display(on_progress, progress, file.duration_s) as report_progress:
        return start_campaign(file, options, Path(out), execution, force=force, on_progress=report_progress)


def start_campaign(
    file: ScenarioFile,
    options: CampaignOptions,
    out: Path,
    execution: Execution | None = None,
    *,
    force: bool = False,
    on_progress: ProgressCallback | None = None,
) -> Campaign:
    """Simulates the runs of a record of options, as `run_campaign` does.

    Raises:
        RpojaxError: the folder cannot be used, or memory or disk are too small.
        UnfinishedError: the results cannot be written.
    """
    used = execution or Execution()
    options = planned(file, options, used)
    if used.shard is None:
        argument_checks.check_folder(out, force)
    # Processes that share a campaign need blocks of the same size, whatever each has of cores.
    is_shared = used.shard is not None or used.executor is not None
    most = len(programs_per_device.choose_devices(used.devices))
    fitted = default_block_size(file) if is_shared else fitted_block_size(file, options.runs, most)
    size = options.block_size or fitted
    options = replace(options, block_size=size)
    devices = programs_per_device.choose_devices(used.devices, most=-(-options.runs // size))
    resource_estimates.check_resources(file, options, size, len(devices), out)
    design = experiment_design.make_design(file, options.seed, options.design_range)
    stages = provenance.replaced_stages(plugin_registry.stages_of(file, used.stages))
    engine = BatchEngine(file, size, devices, used.stages, design)
    configuration = provenance.new_configuration(file, options, stages, design.sha256(), engine.batching)
    check_metrics(file, engine, options.histories)
    if stages:
        engine.channel_names()  # traces replaced stages, which may fail, before there is a folder
    if options.histories.channels is not None:
        history_retention.check_channels(options.histories.channels, engine.channel_names())
    if used.shard is not None:
        folder_creation.join_folder(out, configuration)
    else:
        folder_creation.create_folder(out, configuration, force)
    campaign = Campaign(out)
    executor = used.executor(campaign) if used.executor else LocalExecutor(campaign, engine)
    simulate_missing_blocks(campaign, executor, on_progress, used.shard, used.stages)
    return campaign


def planned(file: ScenarioFile, options: CampaignOptions, execution: Execution) -> CampaignOptions:
    """Options with the looks of a campaign that ends when it is decided; any other's as they are.

    Raises:
        RpojaxError: the scenario cannot be decided, or several processes share the campaign.
    """
    if not options.until_decided:
        return options
    if execution.shard is not None:
        found = "found it with until_decided, expected one process that looks at all runs"
        raise RpojaxError.of_argument("shard", found)
    return sequential_looks.with_plan(file, options, len(programs_per_device.choose_devices(execution.devices)))


def _as_retention(histories: Sequence[int] | str | Retention | None) -> Retention:
    if histories is None:
        return DEFAULT_HISTORIES
    if isinstance(histories, str):
        return Retention(histories)
    return histories if isinstance(histories, Retention) else Retention.from_run_ids(histories)


def resume_campaign(
    directory: Path | str,
    *,
    stages: Stages | None = None,
    metrics: Mapping[str, MetricFunction] | None = None,
    allow_plugin: bool = False,
    progress: bool = True,
    on_progress: ProgressCallback | None = None,
    shard: Shard | None = None,
    executor: ExecutorFactory | None = None,
) -> Campaign:
    """Simulates missing blocks and histories of a campaign, and those with lost files; a complete one is not changed.

    Progress is shown on stderr, or given to `on_progress`; with `progress=False` the call is silent. Metrics and stages
    that `run_campaign` got must be given again; with `allow_plugin` the Python file of the scenario's plugin is
    executed.

    Raises:
        RpojaxError: the folder is no campaign or was changed, or `stages` are not those with which it began.
        UnfinishedError: the results cannot be written.
    """
    if metrics:
        plugin_registry.add(Plugin(metrics=metrics))
    campaign = Campaign(directory, allow_plugin=allow_plugin)
    folder_creation.remove_stale_files(campaign.directory)
    release_lost(campaign, shard)
    campaign.verify()
    blocks = (shard or ALL_BLOCKS).select(campaign.missing_blocks())
    if blocks or not campaign.has_ended:
        found = plugin_registry.stages_of(campaign.file, stages)
        provenance.check_same_stages(campaign.configuration.stages, found)
        if executor is None:
            devices = programs_per_device.choose_devices(None, most=max(1, len(blocks)))
            engine = campaign_engine.recreate_engine(campaign.configuration, devices, stages)
            chosen: Executor = LocalExecutor(campaign, engine)
        else:
            chosen = executor(campaign)
        with _progress_display(on_progress, progress, campaign.file.duration_s) as report_progress:
            simulate_missing_blocks(campaign, chosen, report_progress, shard, stages)
    elif not campaign.missing_blocks():
        selected_histories.remove_displaced_histories(campaign)
        if not selected_histories.pending_histories(campaign):
            return campaign
        with _progress_display(on_progress, progress, campaign.file.duration_s) as report_progress:
            _simulate_selected_histories(campaign, report_progress, stages)
    return campaign


def release_lost(campaign: Campaign, shard: Shard | None = None) -> list[LostFile]:
    """Makes blocks with a file that is missing or cut short unfinished, without such histories; returns the files.

    Raises:
        UnfinishedError: a manifest or history cannot be removed.
        ResultError: a path leads out of the folder.
    """
    own = set((shard or ALL_BLOCKS).select(range(campaign.block_count)))
    manifests = {block: entry for block, entry in campaign.manifests.items() if block in own}
    lost = lost_results.lost_blocks(campaign.directory, campaign.configuration, manifests)
    if lost:
        lost_results.remove_lost_surface(campaign.directory)
    for block in lost:
        block_manifests.remove(campaign.directory, block)
    # After the manifests: a resume that is killed in between finds the block unfinished, and goes on from here.
    rewritten = own & set(campaign.missing_blocks())
    for run_id in campaign.history_ids:
        block = (run_id - campaign.configuration.options.first_run) // campaign.configuration.block_size
        if block in rewritten and lost_results.lost_history(campaign.directory, run_id) is not None:
            campaign.remove_history(run_id)
    return list(lost.values())


@contextmanager
def _progress_display(
    on_progress: ProgressCallback | None, progress: bool, duration_s: float
) -> Iterator[ProgressCallback]:
    """The caller's `on_progress`, or a display on stderr, which `progress=False` switches off."""
    if on_progress is not None:
        yield on_progress
    else:
        with run_progress(duration_s, quiet=not progress) as shown:
            yield shown


def is_complete(campaign: Campaign) -> bool:
    """Whether a campaign has all its blocks, and all histories that its results select."""
    return campaign.has_ended and not campaign.missing_blocks() and not selected_histories.pending_histories(campaign)


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
    report_progress = on_progress or (lambda progress: None)
    total = sum(campaign.configuration.runs_in_block(block) for block in blocks)
    before = (0, 0)
    for group in [blocks] if campaign.has_ended else sequential_looks.blocks_by_look(campaign):
        report_runs = partial(_report_runs, report_progress, total, before)
        if group:
            campaign.failed_blocks.update(executor.run_blocks(group, report_runs))
            before = (before[0] + sum(map(campaign.configuration.runs_in_block, group)), int(campaign.failed.sum()))
    if not campaign.missing_blocks():
        selected_histories.remove_displaced_histories(campaign)
        engine = executor.engine if isinstance(executor, LocalExecutor) else None
        _simulate_selected_histories(campaign, report_progress, stages, engine)


def _report_runs(
    on_progress: ProgressCallback, total: int, before: tuple[int, int], done: float, failed: int, compiled: bool
) -> None:
    """Reports progress of some blocks, added to the runs done and failed `before` them, for which it was compiled."""
    is_compiled = compiled or before[0] > 0
    on_progress(Progress(done=before[0] + done, total=total, failed=before[1] + failed, compiled=is_compiled))


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
        devices = programs_per_device.choose_devices(None, most=-(-total // campaign.configuration.block_size))
        engine = campaign_engine.recreate_engine(campaign.configuration, devices, stages)

    def report_runs(done: float) -> None:
        on_progress(Progress(done=done, total=total, failed=0, compiled=True, stage="simulating histories"))

    block_runner.simulate_histories(campaign, engine, run_ids, report_runs)
