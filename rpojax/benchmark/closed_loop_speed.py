"""Speed of the closed loop: simulated seconds per second for batches of runs, with the time to compile beside it."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import jax
import numpy as np

from rpojax.benchmark import compile_time, stopwatch
from rpojax.benchmark.stopwatch import REPEATS, Taken
from rpojax.campaign.execution import batch_engine
from rpojax.campaign.execution.batch_engine import Block, Engine
from rpojax.dispersions import designs
from rpojax.dispersions.designs import Population
from rpojax.errors import RpojaxError
from rpojax.scenario.schema import ScenarioFile

BATCHES = (1, 64, 512, 2048)
"""Batch sizes measured by default, besides that of the default block: one run, a small campaign, large blocks."""

LONG_RUN_S = 3000.0
"""Duration of the runs that are counted per hour [s]."""

WORTHWHILE = 0.9
"""Another block size is recommended where a run takes at most this share of its time with the default one."""


@dataclass(frozen=True)
class Speed:
    """One batch size.

    Attributes:
        batch: runs at once
        devices: devices that share them
        compile_s: tracing and compiling both programs [s]
        loop_compile_s: of that, what XLA takes for the loop [s]
        compile_cached_s: the same in a later process, which finds them in the cache [s]
        run_s: fastest pass through the scenario [s]
        cpu_s: what it took of the processor [s]
        run_seconds_per_s: simulated seconds, summed over the runs, per second
        runs_per_hour: runs of `LONG_RUN_S` per hour
    """

    batch: int
    devices: int
    compile_s: float
    loop_compile_s: float
    compile_cached_s: float
    run_s: float
    cpu_s: float
    run_seconds_per_s: float
    runs_per_hour: float


def default_batch(file: ScenarioFile) -> int:
    """Runs that a campaign takes at once on this machine."""
    return batch_engine.block_size(file) * len(jax.devices())


def default_batches(file: ScenarioFile) -> tuple[int, ...]:
    """Batch sizes that are measured unless others are asked for; pictures leave no room for large ones."""
    fixed = BATCHES[:1] if file.camera.model == "rendered" else BATCHES
    return tuple(sorted({*fixed, default_batch(file)}))


def check(batches: Sequence[int]) -> None:
    """Refuses batch sizes that make no sense.

    Raises:
        RpojaxError: there is no batch, or one is not positive.
    """
    if not batches or min(batches) < 1:
        raise RpojaxError(f"--runs: found {list(batches)}, expected batch sizes from 1")


def prepare(file: ScenarioFile, batch: int, devices: Sequence[Any] | None = None) -> Engine:
    """Compiled engine that takes `batch` runs at once, spread evenly over the devices."""
    used = list(jax.devices() if devices is None else devices)[:batch]
    size = -(-batch // len(used))
    ready = Engine(file, size, used, design=designs.make(file, 0, Population(0, size * len(used))))
    ready.compile()
    return ready


def block(ready: Engine) -> Block:
    """A full batch of runs, ready on the devices."""
    runs = ready.prepare(0, np.arange(ready.capacity))
    jax.block_until_ready(runs.shares)
    return runs


def carry(ready: Engine, runs: Block) -> None:
    """Carries a batch to the end of the scenario and its channels to the host."""
    for _ in ready.run(runs):
        pass


def flown(ready: Engine) -> Taken:
    """What one pass of a full batch through the scenario takes."""
    runs = block(ready)
    return stopwatch.timed(lambda: carry(ready, runs))


def loop_program(ready: Engine) -> Any:
    """The compiled closed loop of the first device, to look into: its text and what XLA counts in it."""
    assert ready._programs is not None
    return ready._programs[1][0]


def speed(ready: Engine, batch: int, compile_cached_s: float, repeats: int = REPEATS) -> Speed:
    """Fastest of some passes, after one that does not count."""
    taken = stopwatch.fastest(lambda: flown(ready), repeats)
    rate = batch * ready.file.duration_s / taken.wall_s
    return Speed(
        batch=batch,
        devices=len(ready.devices),
        compile_s=ready.compile_s,
        loop_compile_s=ready.loop_compile_s,
        compile_cached_s=compile_cached_s,
        run_s=taken.wall_s,
        cpu_s=taken.cpu_s,
        run_seconds_per_s=rate,
        runs_per_hour=3600.0 * rate / LONG_RUN_S,
    )


def measure(file: ScenarioFile, batches: Sequence[int] = BATCHES) -> dict[str, Any]:
    """Speeds of all batch sizes; the headline is that of the fastest batch.

    Raises:
        RpojaxError: there is no batch, or one is not positive.
    """
    check(batches)
    speeds = []
    for batch in batches:
        ready, again_s = compile_time.prepare_twice(lambda batch=batch: prepare(file, batch))
        speeds.append(speed(ready, batch, again_s))
    best = max(speeds, key=lambda entry: entry.run_seconds_per_s)
    return {
        **asdict(best),
        "batches": [asdict(entry) for entry in speeds],
        "scenario": file.name,
        "duration_s": file.duration_s,
        "block_size": batch_engine.block_size(file),
        "recommended_block_size": recommended_block_size(speeds, default_batch(file)),
    }


def recommended_block_size(speeds: Sequence[Speed], default: int) -> int | None:
    """Runs per device and block that are worth asking for instead of the default, if one was measured.

    `default` is the batch that the default block size makes; without its speed there is nothing to compare with.
    """
    usual = next((entry for entry in speeds if entry.batch == default), None)
    best = max(speeds, key=lambda entry: entry.run_seconds_per_s)
    if usual is None or usual.run_seconds_per_s > WORTHWHILE * best.run_seconds_per_s:
        return None
    return -(-best.batch // best.devices)
