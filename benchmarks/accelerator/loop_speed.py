"""The closed loop at the batch size of the aim: compilation, speed, kernels per tick, memory."""

import dataclasses
import time
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np

from benchmarks.accelerator import memory
from benchmarks.accelerator.sizes import Sizes
from rpojax.benchmark import closed_loop_speed, compile_time, kernel_count, timing
from rpojax.campaign.execution.batch_engine import SEGMENT_TICKS, BatchEngine
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

_LISTED_CONTRIBUTIONS = 10


def measure(sizes: Sizes, precision: str) -> Iterator[dict[str, Any]]:
    """One entry: compilation with an empty cache and from a filled one, speed, kernels, memory."""
    file = mission(sizes, precision)
    label = {"batch": sizes.aim_runs, "precision": precision}
    yield memory.measured_or_reason(lambda: _measure_all(file, sizes), **label)


def mission(sizes: Sizes, precision: str) -> ScenarioFile:
    """The nominal mission, shortened, in a given precision."""
    return scenario_loader.load("inspection", [f"duration_s={sizes.loop_duration_s}", f"precision={precision}"])


def _measure_all(file: ScenarioFile, sizes: Sizes) -> dict[str, Any]:
    engine, times = compile_times(file, sizes.aim_runs)
    return {**times, **loop_figures(engine, sizes.repeats), **kernel_figures(engine)}


def compile_times(file: ScenarioFile, batch: int) -> tuple[BatchEngine, dict[str, float]]:
    """A compiled engine, and the parts of its compilation [s].

    The parts are `trace_s`, `lower_s` (with what the preparation of runs takes longer than the loop) and
    `xla_compile_s`, all with an empty cache; `compile_cached_s` is everything in a later process.
    """
    tracing_s: list[float] = []

    def compile_engine() -> BatchEngine:
        engine = closed_loop_speed.build_engine(file, batch)
        begin = time.perf_counter()
        engine.channel_names()  # the least that needs the traces
        tracing_s.append(time.perf_counter() - begin)
        engine.compile()
        return engine

    engine, cached_s = compile_time.compile_cold_and_cached(compile_engine)
    return engine, {
        "trace_s": tracing_s[0],
        "lower_s": engine.compile_s - engine.loop_compile_s,
        "xla_compile_s": engine.loop_compile_s,
        "compile_cached_s": tracing_s[1] + cached_s,
    }


def loop_figures(engine: BatchEngine, repeats: int) -> dict[str, Any]:
    """Speed with and without the copies of channels to the host, and memory."""
    speed = closed_loop_speed.measure_batch(engine, engine.capacity, 0.0, repeats)
    figures = dataclasses.asdict(speed)
    kept = ("devices", "run_s", "cpu_s", "run_seconds_per_s", "runs_per_hour")
    return {
        **{name: figures[name] for name in kept},
        "device_run_seconds_per_s": device_rate(engine, repeats),
        "device_bytes_per_run": memory.bytes_per_run(engine.loop_program, engine.runs_per_device),
        "peak_device_bytes": memory.peak_bytes(),
    }


def device_rate(engine: BatchEngine, repeats: int) -> float:
    """Run-seconds per second of one device whose channels stay on it, from its fastest segment."""
    nominal, values, state = closed_loop_speed.prepare_runs(engine).device_inputs[0]

    def advance() -> None:
        nonlocal state
        state, _ = jax.block_until_ready(engine.loop_program(nominal, values, state, np.int32(SEGMENT_TICKS)))

    elapsed = timing.fastest_pass(lambda: timing.time_call(advance), repeats)
    return engine.runs_per_device * SEGMENT_TICKS * engine.scenario.tick_s / elapsed.wall_s


def kernel_figures(engine: BatchEngine) -> dict[str, Any]:
    """Kernels per tick, and the scopes that contribute most of them."""
    text = engine.loop_program.as_text()
    count = kernel_count.kernels_per_tick(text)
    opened = kernel_count.kernels_per_tick(text, open_functions=True)
    return {
        "kernels_per_tick": count.most,
        "kernels_per_tick_fewest": count.fewest,
        "kernels_per_tick_functions_opened": opened.most,
        "decisions_per_tick": count.decisions,
        "contributions": [
            {**dataclasses.asdict(each), "per_tick": each.per_tick}
            for each in opened.contributions[:_LISTED_CONTRIBUTIONS]
        ],
    }
