"""How long work takes, on the wall and in the processor, and functions that all devices run at once."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import jax

from rpojax.campaign import per_device, traces

REPEATS = 7
"""Timed passes; the fastest counts, since a busy machine only ever adds time."""


@dataclass(frozen=True)
class Taken:
    """What a piece of work took.

    Attributes:
        wall_s: from begin to end [s]
        cpu_s: of all threads together [s]; less than `wall_s` times the cores where others were busy
    """

    wall_s: float
    cpu_s: float


def timed(work: Callable[[], object]) -> Taken:
    """What one pass takes; `work` returns when its results are there."""
    begin, begin_cpu = time.perf_counter(), time.process_time()
    work()
    return Taken(wall_s=time.perf_counter() - begin, cpu_s=time.process_time() - begin_cpu)


def fastest(one: Callable[[], Taken], repeats: int = REPEATS) -> Taken:
    """The fastest of some passes, after one that does not count."""
    one()
    return min((one() for _ in range(repeats)), key=lambda taken: taken.wall_s)


@dataclass(frozen=True)
class Program:
    """A function compiled for some devices.

    Attributes:
        compiled: one program per device
        inputs: arguments of each, on its device
        compile_s: tracing and compiling all of them [s]
    """

    compiled: Sequence[Any]
    inputs: Sequence[tuple[Any, ...]]
    compile_s: float

    def run(self) -> list[Any]:
        """Results of all devices, which work at the same time."""
        # Calls return at once; what is waited for is the last result.
        results = [program(*given) for program, given in zip(self.compiled, self.inputs, strict=True)]
        return jax.block_until_ready(results)

    def fastest(self, repeats: int = REPEATS) -> Taken:
        """The fastest of some passes on all devices."""
        return fastest(lambda: timed(self.run), repeats)


def program(function: Callable[..., Any], shares: Sequence[tuple[Any, ...]], devices: Sequence[Any]) -> Program:
    """`function` compiled for each device, with that device's share of the arguments."""
    inputs = [jax.device_put(share, device) for share, device in zip(shares, devices, strict=True)]
    begin = time.perf_counter()
    wanted = per_device.lowered(traces.traced(function, inputs[0]), inputs[0], devices)
    with ThreadPoolExecutor(len(wanted)) as pool:
        compiled = list(pool.map(lambda each: each.compile(), wanted))
    return Program(compiled, inputs, time.perf_counter() - begin)
