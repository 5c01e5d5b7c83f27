"""Speed of the closed loop: simulated seconds per second for a batch of runs, with the time to compile beside it."""

import os
import platform
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from rpojax.campaign import design
from rpojax.campaign.design import Population
from rpojax.campaign.engine import Block, Engine
from rpojax.errors import RpojaxError
from rpojax.simulation.schema import ScenarioFile
from rpojax.version import __version__

BATCHES = (1, 64, 512)
"""Batch sizes measured by default: one run, a small campaign, a full block for each of two devices."""

REPEATS = 3
"""Timed passes; the fastest counts, since a busy machine only ever adds time."""


@dataclass(frozen=True)
class Speed:
    """One batch size.

    Attributes:
        batch: runs at once
        devices: devices that share them
        compile_s: tracing and compiling both programs [s]
        run_s: fastest pass through the scenario [s]
        run_seconds_per_s: simulated seconds, summed over the runs, per second
    """

    batch: int
    devices: int
    compile_s: float
    run_s: float
    run_seconds_per_s: float


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
    engine = Engine(file, size, used, design=design.make(file, 0, Population(0, size * len(used))))
    engine.compile(seed=0)
    return engine


def block(engine: Engine) -> Block:
    """A full batch of runs, ready on the devices."""
    ready = engine.prepare(0, np.arange(engine.capacity))
    jax.block_until_ready(ready.shares)
    return ready


def carry(engine: Engine, ready: Block) -> None:
    """Carries a batch to the end of the scenario and its channels to the host."""
    for _ in engine.run(ready):
        pass


def fly(engine: Engine) -> float:
    """Time of one pass of a full batch through the scenario [s]."""
    ready = block(engine)
    begin = time.perf_counter()
    carry(engine, ready)
    return time.perf_counter() - begin


def speed(engine: Engine, batch: int, repeats: int = REPEATS) -> Speed:
    """Fastest of some passes, after one that does not count."""
    fly(engine)
    run_s = min(fly(engine) for _ in range(repeats))
    simulated = batch * engine.file.duration_s
    return Speed(batch, len(engine.devices), engine.compile_s, run_s, simulated / run_s)


def measure(file: ScenarioFile, batches: Sequence[int] = BATCHES) -> dict[str, Any]:
    """Speeds of all batch sizes and where they were measured; the headline is that of the fastest batch.

    Raises:
        RpojaxError: there is no batch, or one is not positive.
    """
    check(batches)
    speeds = [speed(prepare(file, batch), batch) for batch in batches]
    best = max(speeds, key=lambda entry: entry.run_seconds_per_s)
    return {
        **asdict(best),
        "batches": [asdict(entry) for entry in speeds],
        "scenario": file.name,
        "duration_s": file.duration_s,
        "machine": machine(),
        "backend": jax.default_backend(),
        "compile_cache": jax.config.jax_compilation_cache_dir is not None,  # pyright: ignore[reportAttributeAccessIssue]
        "versions": {"rpojax": __version__, "jax": jax.__version__, "python": platform.python_version()},
    }


def machine() -> str:
    """Name of the device, or of the processor and its number of cores."""
    kind = jax.devices()[0].device_kind
    return f"{_processor()}, {os.cpu_count()} cores" if kind == "cpu" else kind


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
