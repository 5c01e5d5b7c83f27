"""How long work takes, on the wall and in the processor, and functions that all devices run at once."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import jax

from rpojax.runtime import device_programs, trace_cache

REPEATS = 7
"""Timed passes; the fastest counts, since a busy machine only ever adds time."""


@dataclass(frozen=True)
class ElapsedTime:
    """What a piece of work took.

    Attributes:
        wall_s: from begin to end [s]
        cpu_s: of all threads together [s]; less than `wall_s` times the cores where others were busy
    """

    wall_s: float
    cpu_s: float


def time_call(work: Callable[[], object]) -> ElapsedTime:
    """What one pass takes; `work` returns when its results are there."""
    begin, begin_cpu = time.perf_counter(), time.process_time()
    work()
    return ElapsedTime(wall_s=time.perf_counter() - begin, cpu_s=time.process_time() - begin_cpu)


def fastest_pass(time_pass: Callable[[], ElapsedTime], repeats: int = REPEATS) -> ElapsedTime:
    """The fastest of some passes, after one that does not count."""
    time_pass()
    return min((time_pass() for _ in range(repeats)), key=lambda taken: taken.wall_s)


@dataclass(frozen=True)
class DeviceProgram:
    """A function compiled for some devices.

    Attributes:
        compiled: the program of each device
        inputs: arguments of each, where it runs
        compile_s: tracing and compiling all of them [s]
    """

    compiled: Sequence[Any]
    inputs: Sequence[tuple[Any, ...]]
    compile_s: float

    def run(self) -> list[Any]:
        """Results of all devices, which work at the same time."""
        with ThreadPoolExecutor(len(self.compiled)) as pool:
            return list(pool.map(_run_blocking, self.compiled, self.inputs))

    def fastest_pass(self, repeats: int = REPEATS) -> ElapsedTime:
        """The fastest of some passes on all devices."""
        return fastest_pass(lambda: time_call(self.run), repeats)


def _run_blocking(compiled: Any, inputs: tuple[Any, ...]) -> Any:
    return jax.block_until_ready(compiled(*inputs))


def compile_for_devices(
    function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], devices: Sequence[Any]
) -> DeviceProgram:
    """`function` compiled for the devices, with each device's share of the arguments."""
    places = device_programs.compilation_devices(devices)
    inputs = [jax.device_put(share, place) for share, place in zip(arguments, places, strict=True)]
    begin = time.perf_counter()
    wanted = device_programs.lower_for_devices(trace_cache.load_or_trace(function, inputs[0]), inputs[0], devices)
    with ThreadPoolExecutor(len(wanted)) as pool:
        compiled = dict(zip(wanted, pool.map(lambda each: each.compile(), wanted.values()), strict=True))
    return DeviceProgram([compiled[place] for place in places], inputs, time.perf_counter() - begin)
