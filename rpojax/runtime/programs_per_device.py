"""A function on several devices at once: one program for each accelerator, one for all cores of a CPU, in threads.

Every device calls the same single-device program on its own arguments, so that results do not depend on the number of
devices. Devices that exchange data during a call share one program of another kind, see `device_mesh`.
"""

import time
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import jax
from jax.sharding import SingleDeviceSharding
from jax.stages import Traced

from rpojax.runtime import compiler_options, garbage_collection
from rpojax.runtime.thread_pools import thread_pool

T = TypeVar("T")

CALLS_AHEAD = 2
"""Results that a thread may compute before the caller has taken them; two cover short pauses of a shared core."""

_PINNED = "pinned_host"
"""Kind of memory of the host that a device writes by itself."""


@dataclass(frozen=True)
class DevicePrograms:
    """A function compiled for several devices.

    Attributes:
        programs: of each device
        targets: for each device the one that its program is compiled for, and on which its arguments are placed
        compile_s: XLA's part of the compilation [s]
    """

    programs: list[Any]
    targets: list[Any]
    compile_s: float

    def first(self, count: int) -> "DevicePrograms":
        """Those of the first `count` devices."""
        return replace(self, programs=self.programs[:count], targets=self.targets[:count])

    def place(self, arguments: Sequence[T]) -> list[T]:
        """Arguments of each device, copied to it."""
        return [jax.device_put(each, target) for each, target in zip(arguments, self.targets, strict=True)]

    def call(self, arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Results of all devices, each called with its own arguments."""
        calls = [partial(_call_and_wait, *pair) for pair in zip(self.programs, arguments, strict=True)]
        (results,) = call_in_threads(calls, 1)
        return results


@dataclass(frozen=True)
class DeviceTraces:
    """A function traced for several devices.

    Attributes:
        traces: by the device that the function will be compiled for
        targets: for each device, the one that its program is compiled for
    """

    traces: Mapping[Any, Traced]
    targets: list[Any]

    @property
    def outputs(self) -> Any:
        """Shapes and types of the results of one device."""
        return self.traces[self.targets[0]].out_info

    def compile(self, cpu_options: Mapping[str, Any] = compiler_options.NO_OPTIONS) -> DevicePrograms:
        """Programs of all devices, compiled at the same time."""
        with garbage_collection.suspended():
            lowered = [trace.lower() for trace in self.traces.values()]
        begin = time.perf_counter()
        compiled = dict(zip(self.traces, compiler_options.compile_in_threads(lowered, cpu_options), strict=True))
        programs = [compiled[target] for target in self.targets]
        return DevicePrograms(programs, self.targets, time.perf_counter() - begin)


def trace_for_devices(
    function: Callable[..., Any], arguments: Sequence[Any], devices: Sequence[Any], donate: tuple[int, ...] = ()
) -> DeviceTraces:
    """The function traced once for all devices.

    Args:
        function: of arrays
        arguments: of one device, or their shapes
        devices: the cores of a CPU share the program of the first of them, which threads may run at the same time
        donate: numbers of the donated arguments
    """
    targets = [devices[0] if each.platform == "cpu" else each for each in devices]
    compiled = jax.jit(function, donate_argnums=donate)
    with garbage_collection.suspended():
        traces = {
            target: compiled.trace(*jax.tree.map(partial(_abstract_array, target), tuple(arguments)))
            for target in dict.fromkeys(targets)
        }
    return DeviceTraces(traces, targets)


def call_in_threads(functions: Sequence[Callable[[], T]], times: int) -> Generator[list[T], None, None]:
    """Calls each function `times` times in a thread of its own and yields the results of each round.

    A thread waits only when it is `CALLS_AHEAD` calls ahead of the caller.
    """
    pending: deque[list[Future[T]]] = deque()
    with ExitStack() as stack:
        pools = [stack.enter_context(thread_pool(1)) for _ in functions]
        for number in range(times + CALLS_AHEAD):
            if number < times:
                pending.append([pool.submit(function) for pool, function in zip(pools, functions, strict=True)])
            if number >= CALLS_AHEAD:
                # Yielded without a local reference, so that the caller decides how long results stay in memory.
                yield [each.result() for each in pending.popleft()]


def copied_to_host(arrays: T) -> T:
    """Arrays of one accelerator in memory of the host, which NumPy reads in place; those of a CPU as they are.

    Pinned memory is written many times faster than other memory, of which the system first has to find every page;
    its allocator keeps what was freed.
    """
    device = next(iter(jax.tree.leaves(arrays)[0].devices()))
    if _computes_in_memory_of_the_host(device):
        return arrays
    return jax.device_put(arrays, SingleDeviceSharding(device, memory_kind=_PINNED))


def _computes_in_memory_of_the_host(device: Any) -> bool:
    return device.platform == "cpu" or _PINNED not in {memory.kind for memory in device.addressable_memories()}


def choose_devices(devices: Sequence[Any] | None = None, most: int | None = None) -> list[Any]:
    """The given devices or, by default, all of the process; at most `most`."""
    return list(jax.devices() if devices is None else devices)[:most]


def share_runs(runs: int, most_per_device: int, devices: Sequence[Any] | None = None) -> tuple[list[Any], int]:
    """Devices that share `runs` runs, and the runs that each takes at once."""
    used = choose_devices(devices, runs)
    return used, min(most_per_device, -(-runs // len(used)))


def _abstract_array(device: Any, array: Any) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(array.shape, array.dtype, sharding=SingleDeviceSharding(device))


def _call_and_wait(program: Any, arguments: tuple[Any, ...]) -> Any:
    return jax.block_until_ready(program(*arguments))
