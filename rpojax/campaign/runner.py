"""A campaign from start to finish: blocks through the engine, results into the folder, progress to whoever asks."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from rpojax.campaign import admission, design, engine, replaced, store
from rpojax.campaign.design import Population
from rpojax.campaign.engine import Block, Engine, Segment
from rpojax.campaign.store import Campaign
from rpojax.errors import RpojaxError
from rpojax.flight.computer import Stages
from rpojax.simulation import metrics
from rpojax.simulation import traces as decimated
from rpojax.simulation.schema import ScenarioFile

HISTORIES = 8
"""Full histories kept by default: those of the first runs."""

_RECORDED = (*metrics.CHANNELS, "running")


@dataclass(frozen=True)
class Progress:
    """Where a campaign is.

    Attributes:
        done: run-equivalents finished in this session, fractions of runs under way included
        total: runs to do in this session
        failed: runs failed so far in this session
        compiled: the programs are compiled
    """

    done: float
    total: int
    failed: int
    compiled: bool


Report = Callable[[Progress], None]


def run_campaign(
    file: ScenarioFile,
    runs: int,
    out: Path | str,
    seed: int = 0,
    *,
    first_run: int = 0,
    block_size: int | None = None,
    histories: Sequence[int] | None = None,
    force: bool = False,
    devices: Sequence[Any] | None = None,
    stages: Stages | None = None,
    population: Population | None = None,
    on_progress: Report | None = None,
) -> Campaign:
    """Runs numbers `first_run` to `first_run + runs - 1` of a scenario into a new folder.

    `population` are the runs that the design is made for, where they are more than these.

    Raises:
        RpojaxError: a number is out of range, the folder cannot be used, or memory or disk are too small.
    """
    admission.check_numbers(runs, first_run, seed, block_size)
    admission.check_folder(Path(out), force)
    kept = range(first_run, first_run + min(runs, HISTORIES)) if histories is None else histories
    outside = [i for i in kept if not first_run <= i < first_run + runs]
    if outside:
        raise RpojaxError(f"--histories: found run {outside[0]}, expected runs of this campaign")
    size = block_size or engine.block_size(file)
    used = _enough(devices, -(-runs // size))
    admission.check_size(file, runs, size, len(used), len(set(kept)), Path(out))
    given = design.make(file, seed, population or Population(first_run, runs))
    machine = Engine(file, size, used, stages, given)
    described = replaced.describe(machine.stages)
    wanted = sorted(set(kept))
    result = store.create(Path(out), file, seed, runs, first_run, size, wanted, force, described, given.record())
    complete(result, machine, on_progress)
    return result


def _enough(devices: Sequence[Any] | None, blocks: int) -> list[Any]:
    """As many of the devices as have a block to work on."""
    return list(jax.devices() if devices is None else devices)[:blocks]


def resume_campaign(
    directory: Path | str, *, stages: Stages | None = None, on_progress: Report | None = None
) -> Campaign:
    """Runs whatever blocks of a campaign are missing, with the stages it began with; a finished one is left as it is.

    Raises:
        RpojaxError: the folder is no campaign, or `stages` are not those that it began with.
    """
    result = Campaign(directory)
    if missing := result.missing():
        replaced.check_same(result.info["stages"], stages or Stages())
        file = result.file
        given = design.of_campaign(file, result.info)
        machine = Engine(file, result.info["block_size"], _enough(None, len(missing)), stages, given)
        complete(result, machine, on_progress)
    return result


def complete(result: Campaign, engine: Engine, on_progress: Report | None = None) -> None:
    """Runs the missing blocks of a campaign, as many at once as there are devices."""
    missing = result.missing()
    size = engine.size
    total = sum(min(size, result.info["runs"] - block * size) for block in missing)
    tell = on_progress or (lambda _: None)
    tell(Progress(done=0.0, total=total, failed=0, compiled=False))
    engine.compile(result.info["seed"])
    tell(Progress(done=0.0, total=total, failed=0, compiled=True))
    begin = time.perf_counter()
    done, failed = 0, 0
    for first in range(0, len(missing), len(engine.devices)):
        wave = missing[first : first + len(engine.devices)]
        real = [min(size, result.info["runs"] - block * size) for block in wave]

        def during(share: float, failures: int, real: list[int] = real, done: int = done, failed: int = failed) -> None:
            tell(Progress(done=done + share * sum(real), total=total, failed=failed + failures, compiled=True))

        failed += _run_wave(result, engine, wave, real, during)
        done += sum(real)
    run_s = time.perf_counter() - begin
    simulated = total * result.file.duration_s
    result.write_timing(
        {
            "compile_s": engine.compile_s,
            "run_s": run_s,
            "run_seconds_per_s": simulated / run_s,
            "devices": len(engine.devices),
        }
    )


def _run_wave(
    result: Campaign, engine: Engine, wave: list[int], real: list[int], during: Callable[[float, int], None]
) -> int:
    """Runs some blocks at once, one a device, and stores them; returns how many of their runs failed."""
    size = engine.size
    # A device without a block of its own repeats the last one: shapes, and so the program, stay the same.
    padded = wave + [wave[-1]] * (len(engine.devices) - len(wave))
    block = engine.prepare(result.info["seed"], np.concatenate([result.block_ids(number) for number in padded]))
    wanted = _histories_wanted(result, block, wave, real)
    counted = np.concatenate([np.arange(count) + place * size for place, count in enumerate(real)])
    recorder = _Recorder(engine.scenario.ticks, wanted)
    last = None
    for number, segment in enumerate(engine.run(block)):
        recorder.add(segment)
        last = segment
        during((number + 1) / engine.segments, int((segment.failure[counted] > 0).sum()))
    assert last is not None
    duration = result.file.duration_s
    failure = np.where(last.failed_at < duration, last.failure, 0)
    for place, number in enumerate(wave):
        rows = slice(place * size, place * size + size)
        arrays = _results(result.file, block, recorder, failure, last.failed_at, rows)
        for row, run_id in wanted.items():
            if rows.start <= row < rows.stop:
                result.write_history(
                    run_id, recorder.history(row, result.file, int(failure[row]), float(last.failed_at[row]))
                )
        result.write_block(number, arrays)
    return int((failure[counted] > 0).sum())


def _histories_wanted(result: Campaign, block: Block, wave: list[int], real: list[int]) -> dict[int, int]:
    """Row in the wave -> run number, for the runs whose full history is kept."""
    size = result.info["block_size"]
    wanted = set(result.info["history_ids"])
    rows = [place * size + row for place in range(len(wave)) for row in range(real[place])]
    return {row: int(block.ids[row]) for row in rows if int(block.ids[row]) in wanted}


class _Recorder:
    """Collects the channels that metrics need of all runs, and all channels of a few."""

    def __init__(self, ticks: int, wanted: dict[int, int]) -> None:
        self.ticks = ticks
        self.rows = sorted(wanted)
        self.records: dict[str, np.ndarray] = {}
        self.full: dict[str, np.ndarray] = {}

    def add(self, segment: Segment) -> None:
        stop = segment.first_tick + next(iter(segment.channels.values())).shape[0]
        ticks = slice(segment.first_tick, stop)
        for name, values in segment.channels.items():
            runs_first = np.moveaxis(values, 0, 1)
            if name in _RECORDED:
                self._into(self.records, name, runs_first)[:, ticks] = runs_first
            if self.rows:
                chosen = runs_first[self.rows]
                self._into(self.full, name, chosen)[:, ticks] = chosen

    def _into(self, arrays: dict[str, np.ndarray], name: str, values: np.ndarray) -> np.ndarray:
        if name not in arrays:
            arrays[name] = np.empty((values.shape[0], self.ticks, *values.shape[2:]), dtype=values.dtype)
        return arrays[name]

    def history(self, row: int, file: ScenarioFile, failure: int, failed_at: float) -> dict[str, np.ndarray]:
        place = self.rows.index(row)
        channels = {name: values[place].copy() for name, values in self.full.items() if name != "running"}
        time_s = np.arange(self.ticks) / file.rates.camera_hz
        if failure:
            for values in channels.values():
                if np.issubdtype(values.dtype, np.floating):
                    values[time_s > failed_at] = np.nan
        return {"time_s": time_s, "rho_desired_H": np.asarray(file.formation.desired_position_m), **channels}


def _results(
    file: ScenarioFile, block: Block, recorder: _Recorder, failure: np.ndarray, failed_at: np.ndarray, rows: slice
) -> dict[str, np.ndarray]:
    """Arrays of one block as they are stored; metrics of failed runs are undefined."""
    records = {name: values[rows] for name, values in recorder.records.items()}
    failed = failure[rows] > 0
    results: dict[str, np.ndarray] = {}
    with np.errstate(invalid="ignore"):
        for name, values in metrics.evaluate(file, records).items():
            results[f"metrics/{name}"] = np.where(failed, np.nan, values)
        time_s = np.arange(recorder.ticks)[:: store.trace_stride(file)] / file.rates.camera_hz
        gone = failed[:, None] & (time_s > failed_at[rows][:, None])
        for name, values in decimated.traces(file, records, store.trace_stride(file)).items():
            results[f"traces/{name}"] = np.where(gone, np.float32(np.nan), values)
    results["status/failure"] = failure[rows].astype(np.int8)
    results["status/failed_at_s"] = np.where(failed, failed_at[rows], np.nan)
    for group, values in (("drawn", block.drawn), ("used", block.used)):
        for key, array in values.items():
            results[f"{group}/{key}"] = array[rows]
    return results
