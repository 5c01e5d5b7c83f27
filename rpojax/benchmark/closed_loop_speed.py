"""Speed of the closed loop: simulated seconds per second for batches of runs, and its compilation time."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import jax
import numpy as np

from rpojax.batching.batching_mode import BatchingMode
from rpojax.benchmark import compile_time, timing
from rpojax.benchmark.timing import REPEATS, ElapsedTime
from rpojax.campaign import experiment_design
from rpojax.campaign.execution import batch_engine
from rpojax.campaign.execution.batch_engine import BatchEngine, PreparedRuns
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.errors import RpojaxError
from rpojax.runtime.programs_per_device import share_runs
from rpojax.scenario.schema import ScenarioFile

DEFAULT_BATCHES = (1, 64, 512, 2048)
"""Batch sizes measured by default, besides that of the default block: one run, a small campaign, large blocks."""

REFERENCE_RUN_S = 3000.0
"""Duration of the runs that are counted per hour [s]."""

RECOMMENDED_BELOW = 0.9
"""Another block size is recommended if a run takes at most this fraction of its time with the default one."""


@dataclass(frozen=True)
class ClosedLoopSpeed:
    """Speed of one batch size.

    Attributes:
        batch: runs at once
        devices: devices that share them
        compile_s: tracing and compiling both programs [s]
        loop_compile_s: XLA's part of it for the loop [s]
        compile_cached_s: the same as `compile_s` in a later process, from the cache [s]
        run_s: fastest pass through the scenario [s]
        cpu_s: processor time of that pass [s]
        run_seconds_per_s: simulated seconds, summed over the runs, per second
        runs_per_hour: runs of `REFERENCE_RUN_S` per hour
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
    """Runs that a campaign simulates at once on this machine."""
    return batch_engine.default_block_size(file) * len(jax.devices())


def default_batches(file: ScenarioFile) -> tuple[int, ...]:
    """Batch sizes measured by default; large ones are left out for rendered cameras, which take too long."""
    fixed = DEFAULT_BATCHES[:1] if file.camera.model == "rendered" else DEFAULT_BATCHES
    return tuple(sorted({*fixed, default_batch(file)}))


def check_batches(batches: Sequence[int]) -> None:
    """Refuses an empty list and batch sizes that are not positive.

    Raises:
        RpojaxError: there is no batch, or one is not positive.
    """
    if not batches or min(batches) < 1:
        raise RpojaxError.of_argument("runs", f"found {list(batches)}, expected batch sizes from 1")


def build_engine(
    file: ScenarioFile, batch: int, devices: Sequence[Any] | None = None, batching: BatchingMode | None = None
) -> BatchEngine:
    """Engine, not compiled yet, that simulates `batch` runs at once, divided evenly among the devices."""
    used, size = share_runs(batch, batch, devices)
    design = experiment_design.make_design(file, 0, RunRange(0, size * len(used)))
    return BatchEngine(file, size, used, design=design, batching=batching)


def compile_engine(
    file: ScenarioFile, batch: int, devices: Sequence[Any] | None = None, batching: BatchingMode | None = None
) -> BatchEngine:
    """The same, compiled."""
    engine = build_engine(file, batch, devices, batching)
    engine.compile()
    return engine


def prepare_runs(engine: BatchEngine) -> PreparedRuns:
    """A full batch of runs, ready on the devices."""
    prepared = engine.prepare(0, np.arange(engine.capacity))
    jax.block_until_ready(prepared.device_inputs)
    return prepared


def simulate_runs(engine: BatchEngine, prepared: PreparedRuns) -> None:
    """Simulates a batch to the end of the scenario and copies its channels to the host."""
    for _ in engine.simulate(prepared):
        pass


def time_pass(engine: BatchEngine) -> ElapsedTime:
    """Time of one pass of a full batch through the scenario, without its preparation."""
    prepared = prepare_runs(engine)
    return timing.time_call(lambda: simulate_runs(engine, prepared))


def measure_batch(engine: BatchEngine, batch: int, compile_cached_s: float, repeats: int = REPEATS) -> ClosedLoopSpeed:
    """Speed of one batch size, from its fastest pass."""
    elapsed = timing.fastest_pass(lambda: time_pass(engine), repeats)
    rate = batch * engine.file.duration_s / elapsed.wall_s
    return ClosedLoopSpeed(
        batch=batch,
        devices=len(engine.devices),
        compile_s=engine.compile_s,
        loop_compile_s=engine.loop_compile_s,
        compile_cached_s=compile_cached_s,
        run_s=elapsed.wall_s,
        cpu_s=elapsed.cpu_s,
        run_seconds_per_s=rate,
        runs_per_hour=3600.0 * rate / REFERENCE_RUN_S,
    )


def measure(file: ScenarioFile, batches: Sequence[int] = DEFAULT_BATCHES) -> dict[str, Any]:
    """Speeds of all batch sizes as JSON, with those of the fastest batch at the top.

    Raises:
        RpojaxError: there is no batch, or one is not positive.
    """
    check_batches(batches)
    speeds = []
    for batch in batches:
        engine, cached_s = compile_time.compile_cold_and_cached(lambda batch=batch: compile_engine(file, batch))
        speeds.append(measure_batch(engine, batch, cached_s))
    best = max(speeds, key=lambda entry: entry.run_seconds_per_s)
    return {
        **asdict(best),
        "batches": [asdict(entry) for entry in speeds],
        "scenario": file.name,
        "duration_s": file.duration_s,
        "block_size": batch_engine.default_block_size(file),
        "recommended_block_size": recommended_block_size(speeds, default_batch(file)),
    }


def recommended_block_size(speeds: Sequence[ClosedLoopSpeed], default: int) -> int | None:
    """Block size of the fastest batch, if it is clearly faster than the default one.

    `default` is the batch of the default block size; without its speed there is no recommendation.
    """
    default_speed = next((entry for entry in speeds if entry.batch == default), None)
    best = max(speeds, key=lambda entry: entry.run_seconds_per_s)
    if default_speed is None or default_speed.run_seconds_per_s > RECOMMENDED_BELOW * best.run_seconds_per_s:
        return None
    return -(-best.batch // best.devices)
