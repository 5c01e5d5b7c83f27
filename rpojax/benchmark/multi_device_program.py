"""A function compiled for several devices, which run it at the same time."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import jax

from rpojax.benchmark import timing
from rpojax.benchmark.timing import REPEATS, ElapsedTime
from rpojax.runtime import compiler_options, device_programs


@dataclass(frozen=True)
class MultiDeviceProgram:
    """One compiled program per device, with its arguments.

    Attributes:
        compiled: the program of each device
        inputs: arguments of each program, on its device
        compile_s: tracing and compiling all of them [s]
    """

    compiled: Sequence[Any]
    inputs: Sequence[tuple[Any, ...]]
    compile_s: float

    def run(self) -> list[Any]:
        """Results of all devices."""
        with ThreadPoolExecutor(len(self.compiled)) as pool:
            return list(pool.map(_run_blocking, self.compiled, self.inputs))

    def fastest_pass(self, repeats: int = REPEATS) -> ElapsedTime:
        """The fastest of some passes on all devices."""
        return timing.fastest_pass(lambda: timing.time_call(self.run), repeats)


def _run_blocking(compiled: Any, inputs: tuple[Any, ...]) -> Any:
    return jax.block_until_ready(compiled(*inputs))


def _compile(lowered: Any) -> Any:
    return compiler_options.compile_with_options(lowered, {})


def compile_for_devices(
    function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], devices: Sequence[Any]
) -> MultiDeviceProgram:
    """Compiles `function` for the devices; `arguments` holds those of each device."""
    targets = device_programs.compilation_devices(devices)
    inputs = [jax.device_put(each, target) for each, target in zip(arguments, targets, strict=True)]
    begin = time.perf_counter()
    lowered = device_programs.lower(device_programs.trace_for_devices(function, inputs[0], devices))
    with ThreadPoolExecutor(len(lowered)) as pool:
        compiled = dict(zip(lowered, pool.map(_compile, lowered.values()), strict=True))
    return MultiDeviceProgram([compiled[target] for target in targets], inputs, time.perf_counter() - begin)
