"""Wall-clock and processor time of a piece of work, and the fastest of several repetitions."""

import time
from collections.abc import Callable
from dataclasses import dataclass

REPEATS = 7
"""Timed passes; the fastest counts, since a busy machine only ever adds time."""


@dataclass(frozen=True)
class ElapsedTime:
    """Duration of a piece of work.

    Attributes:
        wall_s: from begin to end [s]
        cpu_s: processor time of all threads [s]; less than `wall_s` times the cores if other processes used them
    """

    wall_s: float
    cpu_s: float


def time_call(work: Callable[[], object]) -> ElapsedTime:
    """Duration of one call; `work` must return only when its results are computed."""
    begin, begin_cpu = time.perf_counter(), time.process_time()
    work()
    return ElapsedTime(wall_s=time.perf_counter() - begin, cpu_s=time.process_time() - begin_cpu)


def fastest_pass(time_pass: Callable[[], ElapsedTime], repeats: int = REPEATS) -> ElapsedTime:
    """The fastest of some passes, after one that warms up."""
    time_pass()
    return min((time_pass() for _ in range(repeats)), key=lambda elapsed: elapsed.wall_s)
