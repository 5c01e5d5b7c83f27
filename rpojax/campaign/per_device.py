"""One traced function for several devices at once: each runs a program of its own, but the cores of a CPU share one."""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import jax
from jax.sharding import SingleDeviceSharding

from rpojax.campaign.traces import Trace


def homes(devices: Sequence[Any]) -> list[Any]:
    """The device on which the program of each is compiled and run.

    XLA compiles for one device alone, and threads may run what is compiled for one core of a CPU side by side: that
    takes a core each, and is compiled once.
    """
    return [devices[0] if each.platform == "cpu" else each for each in devices]


def lowered(
    trace: Trace, arguments: Sequence[Any], devices: Sequence[Any], donate: tuple[int, ...] = ()
) -> dict[Any, Any]:
    """The function lowered for each home of the devices, to be compiled; `donate` numbers the arguments given up."""
    wanted = jax.jit(trace.call, donate_argnums=donate)
    return {
        home: wanted.lower(*jax.tree.map(lambda each, on=home: _shape(each, on), arguments))
        for home in dict.fromkeys(homes(devices))
    }


def started(pool: ThreadPoolExecutor, programs: Sequence[Any], inputs: Sequence[tuple[Any, ...]]) -> list[Future[Any]]:
    """Results to come of programs that run at the same time, each in a thread of the pool."""
    return [pool.submit(_results, program, given) for program, given in zip(programs, inputs, strict=True)]


def _results(program: Any, given: tuple[Any, ...]) -> Any:
    return jax.block_until_ready(program(*given))


def _shape(array: Any, device: Any) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(array.shape, array.dtype, sharding=SingleDeviceSharding(device))
