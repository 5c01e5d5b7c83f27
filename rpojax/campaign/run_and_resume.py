"""A campaign from start to finish: into a folder, through an executor, progress to whoever asks."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax

from rpojax.campaign import history_retention, preflight, stage_provenance
from rpojax.campaign.execution import batch_engine, block_runner, executors
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.execution.executors import Executor
from rpojax.campaign.history_retention import Retention
from rpojax.campaign.storage import atomic_files, campaign_json, folder_creation
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.dispersions import designs
from rpojax.dispersions.designs import RunRange
from rpojax.errors import RpojaxError
from rpojax.flight.computer import Stages
from rpojax.runtime.progress import Progress
from rpojax.scenario.schema import ScenarioFile

DEFAULT_HISTORIES = 8
"""Full histories kept by default: those of the first runs."""


ProgressCallback = Callable[[Progress], None]
ExecutorFactory = Callable[[Campaign], Executor]


@dataclass(frozen=True)
class Shard:
    """Part `number` of `count`, from 1: the blocks b with b % count == number - 1."""

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """Part written as `2/8`.

        Raises:
            RpojaxError: it is not written so, or there is no such part.
        """
        found = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text)
        if not found or not 1 <= int(found[1]) <= int(found[2]):
            raise RpojaxError(f"--shard: found {text!r}, expected i/n with i from 1 to n, such as 2/8")
        return cls(int(found[1]), int(found[2]))

    def select(self, blocks: Sequence[int]) -> list[int]:
        """Those blocks that belong to this part."""
        return [block for block in blocks if block % self.count == self.number - 1]


ALL_BLOCKS = Shard(1, 1)


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
    population: RunRange | None = None,
    on_progress: ProgressCallback | None = None,
    shard: Shard | None = None,
    executor: ExecutorFactory | None = None,
    report: bool = False,
) -> Campaign:
    """Runs numbers `first_run` to `first_run + runs - 1` of a scenario into a new folder.

    With a `shard` the folder may be one that other shards of the same campaign have made, and only the shard's blocks
    are run. `executor` says how; the default is on all devices of this process.
    `population` are the runs that the design is made for, where they are more than these. `report` is noted in the
    folder: whoever finishes the campaign with a verb writes one.

    Raises:
        RpojaxError: a number is out of range, the folder cannot be used, or memory or disk are too small.
        UnfinishedError: the results cannot be written.
    """
    preflight.check_numbers(runs, first_run, seed, block_size)
    if shard is None:
        preflight.check_folder(Path(out), force)
    kept = _retention(histories, first_run, runs)
    kept.check_run_ids(first_run, runs)
    size = block_size or batch_engine.default_block_size(file)
    used = _devices_for_blocks(devices, -(-runs // size))
    expected = -(-kept.max_histories(first_run, runs) // kept.every)
    preflight.check_resources(file, runs, size, len(used), expected, Path(out))
    described = stage_provenance.replaced_stages(stages or Stages())
    given = designs.make_design(file, seed, population or RunRange(first_run, runs))
    asked = folder_creation.new_configuration(
        file, seed, runs, first_run, size, kept.to_record(), described, given.record(), report
    )
    machine = BatchEngine(file, size, used, stages, given)
    if kept.channels is not None:
        history_retention.check_channels(kept.channels, machine.channel_names())
    if shard is None:
        folder_creation.create_folder(Path(out), asked, force)
    else:
        folder_creation.join_folder(Path(out), asked)
    result = Campaign(out)
    simulate_missing_blocks(
        result, executor(result) if executor else executors.LocalExecutor(result, machine), on_progress, shard, stages
    )
    return result


def _retention(histories: Sequence[int] | Retention | None, first_run: int, runs: int) -> Retention:
    if isinstance(histories, Retention):
        return histories
    return Retention.from_run_ids(
        range(first_run, first_run + min(runs, DEFAULT_HISTORIES)) if histories is None else histories
    )


def _devices_for_blocks(devices: Sequence[Any] | None, blocks: int) -> list[Any]:
    """As many of the devices as have a block to work on."""
    return list(jax.devices() if devices is None else devices)[:blocks]


def resume_campaign(
    directory: Path | str,
    *,
    stages: Stages | None = None,
    on_progress: ProgressCallback | None = None,
    shard: Shard | None = None,
    executor: ExecutorFactory | None = None,
) -> Campaign:
    """Runs whatever of a campaign is missing, with the stages it began with; a finished one is left as it is.

    Raises:
        RpojaxError: the folder is no campaign, or `stages` are not those that it began with.
        UnfinishedError: the results cannot be written.
    """
    result = Campaign(directory)
    atomic_files.remove_stale_files(result.directory)
    if blocks := (shard or ALL_BLOCKS).select(result.missing_blocks()):
        stage_provenance.check_same_stages(result.configuration["stages"], stages or Stages())
        if executor is None:
            machine = block_runner.engine_from_configuration(
                result.configuration, _devices_for_blocks(None, len(blocks)), stages
            )
            simulate_missing_blocks(result, executors.LocalExecutor(result, machine), on_progress, shard, stages)
        else:
            simulate_missing_blocks(result, executor(result), on_progress, shard, stages)
    elif not result.missing_blocks():
        _simulate_selected_histories(result, on_progress or (lambda _: None), stages)
    return result


def is_complete(campaign: Campaign) -> bool:
    """Whether nothing of a campaign is missing, neither blocks nor histories of chosen runs."""
    return not campaign.missing_blocks() and not block_runner.pending_histories(campaign)


def simulate_missing_blocks(
    campaign: Campaign,
    executor: Executor,
    on_progress: ProgressCallback | None = None,
    shard: Shard | None = None,
    stages: Stages | None = None,
) -> None:
    """Runs the missing blocks of a campaign, then flies runs again whose histories are to be kept for their results.

    Blocks that the executor gives up are noted in `result.given_up`, and the others go on.
    """
    blocks = (shard or ALL_BLOCKS).select(campaign.missing_blocks())
    tell = on_progress or (lambda _: None)
    total = sum(campaign_json.runs_in_block(campaign.configuration, block) for block in blocks)

    def during(done: float, failed: int, compiled: bool) -> None:
        tell(Progress(done=done, total=total, failed=failed, compiled=compiled))

    if blocks:
        campaign.failed_blocks.update(executor.run_blocks(blocks, during))
    if not campaign.missing_blocks():
        _simulate_selected_histories(
            campaign, tell, stages, executor.engine if isinstance(executor, executors.LocalExecutor) else None
        )


def _simulate_selected_histories(
    result: Campaign, tell: ProgressCallback, stages: Stages | None, machine: BatchEngine | None = None
) -> None:
    """Keeps the histories that depend on results, with the engine of the first pass where there is one."""
    chosen = block_runner.pending_histories(result)
    if not chosen:
        return
    if machine is None:
        tell(Progress(done=0.0, total=len(chosen), failed=0, compiled=False))
        used = _devices_for_blocks(None, -(-len(chosen) // result.configuration["block_size"]))
        machine = block_runner.engine_from_configuration(result.configuration, used, stages)

    def during(done: float) -> None:
        tell(Progress(done=done, total=len(chosen), failed=0, compiled=True))

    block_runner.simulate_histories(result, machine, chosen, during)
