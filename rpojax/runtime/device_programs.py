"""A traced function on several devices at once: one program for each accelerator, one for all cores of a CPU."""

from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

import jax
from jax.sharding import SingleDeviceSharding
from jax.stages import Lowered, Traced

from rpojax.runtime import garbage_collection

T = TypeVar("T")

CALLS_AHEAD = 2
"""Results that a thread may compute before the caller has taken them; two cover short pauses of a shared core."""


def compilation_devices(devices: Sequence[Any]) -> list[Any]:
    """For each device, the device that its program is compiled for.

    The cores of a CPU share a program compiled for the first of them, which threads may run concurrently.
    """
    return [devices[0] if each.platform == "cpu" else each for each in devices]


def trace_for_devices(
    function: Callable[..., Any], arguments: Sequence[Any], devices: Sequence[Any], donate: tuple[int, ...] = ()
) -> dict[Any, Traced]:
    """The function traced once, for each of the `compilation_devices`; `donate` numbers the donated arguments."""
    compiled = jax.jit(function, donate_argnums=donate)
    with garbage_collection.suspended():
        return {
            device: compiled.trace(*jax.tree.map(lambda each, on=device: _abstract_array(each, on), arguments))
            for device in dict.fromkeys(compilation_devices(devices))
        }


def lower(traces: Mapping[Any, Traced]) -> dict[Any, Lowered]:
    """Traces of `trace_for_devices`, lowered."""
    with garbage_collection.suspended():
        return {device: trace.lower() for device, trace in traces.items()}


def call_in_threads(functions: Sequence[Callable[[], T]], times: int) -> Generator[list[T], None, None]:
    """Calls each function `times` times in a thread of its own and yields the results of each round.

    A thread waits only when it is `CALLS_AHEAD` calls ahead of the caller.
    """
    pools = [ThreadPoolExecutor(1) for _ in functions]
    pending: deque[list[Future[T]]] = deque()
    try:
        for number in range(times + CALLS_AHEAD):
            if number < times:
                pending.append([pool.submit(function) for pool, function in zip(pools, functions, strict=True)])
            if number >= CALLS_AHEAD:
                # Yielded without a local reference, so that the caller decides how long results stay in memory.
                yield [each.result() for each in pending.popleft()]
    finally:
        for pool in pools:
            pool.shutdown(wait=False, cancel_futures=True)
        for pool in pools:
            pool.shutdown()


def _abstract_array(array: Any, device: Any) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(array.shape, array.dtype, sharding=SingleDeviceSharding(device))
