"""Blocks of a campaign through the engine and into the folder; runs flown a second time for their histories."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.campaign import stage_provenance
from rpojax.campaign.execution import block_recording
from rpojax.campaign.execution.batch_engine import Block, Engine
from rpojax.campaign.execution.block_recording import Recorder
from rpojax.campaign.history_retention import Retention
from rpojax.campaign.storage import block_manifests, campaign_json, folder_creation
from rpojax.campaign.storage.campaign_folder import Campaign, Effort
from rpojax.dispersions import designs
from rpojax.errors import RpojaxError
from rpojax.flight.computer import Stages
from rpojax.scenario import scenario_file

_DECISIVE = ("rpojax", "jax")
"""Packages that a run's last digits depend on."""

During = Callable[[float, int], None]
"""Told the share of a batch of runs that is done, and how many of them have failed."""


def engine_of(asked: Mapping[str, Any], devices: Sequence[Any], stages: Stages | None = None) -> Engine:
    """The engine of a campaign that was begun, as its `campaign.json` asks for it.

    Raises:
        RpojaxError: the scenario, its trained files or the stages are not those of the campaign.
    """
    file = scenario_file.validate(asked["scenario"])
    if scenario_file.digest(file) != asked["scenario_hash"]:
        raise RpojaxError(
            "scenario: found another content or trained files, expected those that the campaign began with"
        )
    stage_provenance.check_same(asked["stages"], stages or Stages())
    return Engine(file, asked["block_size"], devices, stages, designs.of_campaign(file, asked))


@dataclass(frozen=True)
class Flown:
    """A batch of runs at their end.

    Attributes:
        block: the runs as they were prepared
        recorder: their channels
        failure: (runs,) code of failure
        failed_at: (runs,) [s]
    """

    block: Block
    recorder: Recorder
    failure: np.ndarray
    failed_at: np.ndarray

    def history(self, row: int, engine: Engine) -> dict[str, np.ndarray]:
        """Wanted channels of one run."""
        return self.recorder.history(row, engine.file, int(self.failure[row]), float(self.failed_at[row]))

    def results(self, rows: slice, engine: Engine) -> dict[str, np.ndarray]:
        """Arrays of a block as they are stored."""
        return block_recording.results(engine.file, self.block, self.recorder, self.failure, self.failed_at, rows)


def fly(
    engine: Engine,
    seed: int,
    ids: np.ndarray,
    kept: Sequence[int],
    counted: np.ndarray,
    retention: Retention,
    during: During,
) -> Flown:
    """Carries `engine.capacity` runs to their end; `kept` rows have a history, `counted` ones are no padding."""
    block = engine.prepare(seed, ids)
    recorder = Recorder(engine.scenario.ticks, kept, retention.wants)
    last = None
    for number, segment in enumerate(engine.run(block)):
        recorder.add(segment)
        last = segment
        during((number + 1) / engine.segments, int((segment.failure[counted] > 0).sum()))
    assert last is not None
    failure = np.where(last.failed_at < engine.file.duration_s, last.failure, 0)
    return Flown(block, recorder, failure, last.failed_at)


def check_versions(recorded: Mapping[str, str]) -> None:
    """Refuses to add blocks with other packages than those that a campaign began with: their last digits may differ.

    Raises:
        RpojaxError: naming the package.
    """
    here = folder_creation.versions()
    for name in _DECISIVE:
        if recorded.get(name) != here[name]:
            raise RpojaxError(
                f"{name}: found version {here[name]}, expected {recorded.get(name)}, with which the campaign began"
            )


@dataclass(frozen=True)
class Landed:
    """Blocks that were flown at once, to be stored.

    Attributes:
        blocks: their numbers
        flown: their runs, padded to a full batch
        effort: what they took
        kept: rows that have a history
        failures: how many of their runs failed
    """

    blocks: Sequence[int]
    flown: Flown
    effort: Effort
    kept: Sequence[int]
    failures: int


def do_blocks(result: Campaign, engine: Engine, wave: Sequence[int], during: During) -> int:
    """Flies some blocks at once, one a device, and stores them; returns how many of their runs failed.

    Raises:
        UnfinishedError: they cannot be stored.
    """
    landed = fly_blocks(result, engine, wave, during)
    store_blocks(result, engine, landed)
    return landed.failures


def fly_blocks(result: Campaign, engine: Engine, wave: Sequence[int], during: During) -> Landed:
    """Flies some blocks at once, one a device."""
    check_versions(result.asked["versions"])
    engine.compile()
    for block in wave:
        block_manifests.begin(result.directory, block)
    began_s = time.time()
    # A device without a block of its own repeats the last one: shapes, and so the program, stay the same.
    padded = [*wave, *[wave[-1]] * (len(engine.devices) - len(wave))]
    ids = np.concatenate([result.block_ids(block) for block in padded])
    size, retention = engine.size, Retention.read(result.asked["histories"])
    counts = [campaign_json.count(result.asked, block) for block in wave]
    counted = np.concatenate([np.arange(count) + place * size for place, count in enumerate(counts)])
    known = retention.known(result.asked["first_run"], result.asked["runs"])
    kept = [row for row in counted.tolist() if int(ids[row]) in known]
    flown = fly(engine, result.asked["seed"], ids, kept, counted, retention, during)
    # Storing is left out: meanwhile the next blocks are flown.
    wall_s = max(0.0, time.time() - began_s)
    effort = Effort(began_s, wall_s, engine.compile_s, folder_creation.device(len(engine.devices)))
    return Landed(wave, flown, effort, kept, int((flown.failure[counted] > 0).sum()))


def store_blocks(result: Campaign, engine: Engine, landed: Landed) -> None:
    """Stores blocks that were flown.

    Raises:
        UnfinishedError: they cannot be stored.
    """
    size, retention, flown = engine.size, Retention.read(result.asked["histories"]), landed.flown
    for place, block in enumerate(landed.blocks):
        rows = slice(place * size, place * size + size)
        for row in landed.kept:
            if rows.start <= row < rows.stop:
                history = retention.of(flown.history(row, engine), engine.scenario.ticks)
                result.write_history(int(flown.block.ids[row]), history)
        result.write_block(block, flown.results(rows, engine), landed.effort)


def later_histories(result: Campaign) -> list[int]:
    """Runs whose history is to be kept for what became of them, and is not there yet; once all blocks are done."""
    retention = Retention.read(result.asked["histories"])
    if not retention.looks_at_results:
        return []
    return sorted(retention.later(result.run_ids, result.completed, result.metrics) - set(result.history_ids))


def do_histories(result: Campaign, engine: Engine, run_ids: Sequence[int], tell: Callable[[float], None]) -> None:
    """Flies some runs a second time, in blocks of the size of the first, and stores their histories.

    Raises:
        UnfinishedError: they cannot be stored.
    """
    retention = Retention.read(result.asked["histories"])
    engine.compile()
    for first in range(0, len(run_ids), engine.capacity):
        batch = list(run_ids[first : first + engine.capacity])
        ids = np.array(batch + [batch[-1]] * (engine.capacity - len(batch)))
        rows = np.arange(len(batch))

        def during(share: float, _: int, first: int = first, count: int = len(batch)) -> None:
            tell(first + share * count)

        flown = fly(engine, result.asked["seed"], ids, rows.tolist(), rows, retention, during)
        for row, run_id in enumerate(batch):
            result.write_history(run_id, retention.of(flown.history(row, engine), engine.scenario.ticks))
