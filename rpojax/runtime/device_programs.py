"""One traced function for several devices at once: each runs a program of its own, but the cores of a CPU share one."""

from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

import jax
from jax.sharding import SingleDeviceSharding

from rpojax.runtime.trace_cache import Trace

T = TypeVar("T")

CALLS_AHEAD = 2
"""Calls that may wait to be looked at: enough for threads that share a core with others for a moment."""


def compilation_devices(devices: Sequence[Any]) -> list[Any]:
    """The device on which the program of each is compiled and run.

    XLA compiles for one device alone, and threads may run what is compiled for one core of a CPU side by side: that
    takes a core each, and is compiled once.
    """
    return [devices[0] if each.platform == "cpu" else each for each in devices]


def lower_for_devices(
    trace: Trace, arguments: Sequence[Any], devices: Sequence[Any], donate: tuple[int, ...] = ()
) -> dict[Any, Any]:
    """The function lowered for each home of the devices, to be compiled; `donate` numbers the arguments given up."""
    wanted = jax.jit(trace.call, donate_argnums=donate)
    return {
        home: wanted.lower(*jax.tree.map(lambda each, on=home: _abstract_array(each, on), arguments))
        for home in dict.fromkeys(compilation_devices(devices))
    }


def call_in_threads(functions: Sequence[Callable[[], T]], times: int) -> Generator[list[T], None, None]:
    """What each of some functions gives, `times` times, each in a thread of its own.

    A thread waits for the others only when it is `AHEAD` calls ahead of what the caller looks at.
    """
    pools = [ThreadPoolExecutor(1) for _ in functions]
    pending: deque[list[Future[T]]] = deque()
    try:
        for number in range(times + CALLS_AHEAD):
            if number < times:
                pending.append([pool.submit(work) for pool, work in zip(pools, functions, strict=True)])
            if number >= CALLS_AHEAD:
                # Not kept here while the caller looks at them.
                yield [each.result() for each in pending.popleft()]
    finally:
        for pool in pools:
            pool.shutdown(wait=False, cancel_futures=True)
        for pool in pools:
            pool.shutdown()


def _abstract_array(array: Any, device: Any) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(array.shape, array.dtype, sharding=SingleDeviceSharding(device))
