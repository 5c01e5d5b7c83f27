"""A function compiled for several devices, with the arguments of each, for measuring its speed."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rpojax.benchmark import timing
from rpojax.benchmark.timing import REPEATS, ElapsedTime
from rpojax.runtime import programs_per_device
from rpojax.runtime.programs_per_device import DevicePrograms


@dataclass(frozen=True)
class MultiDeviceProgram:
    """A function compiled for several devices, with its arguments.

    Attributes:
        programs: of all devices
        inputs: arguments of each program, on its device
        compile_s: tracing and compiling [s]
    """

    programs: DevicePrograms
    inputs: Sequence[tuple[Any, ...]]
    compile_s: float

    def run(self) -> list[Any]:
        """Results of all devices."""
        return self.programs.call(self.inputs)

    def fastest_pass(self, repeats: int = REPEATS) -> ElapsedTime:
        """The fastest of some passes on all devices."""
        return timing.fastest_pass(lambda: timing.time_call(self.run), repeats)


def compile_for_devices(
    function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], devices: Sequence[Any]
) -> MultiDeviceProgram:
    """Compiles `function` for the devices; `arguments` holds those of each device."""
    begin = time.perf_counter()
    programs = programs_per_device.trace_for_devices(function, arguments[0], devices).compile()
    compile_s = time.perf_counter() - begin
    return MultiDeviceProgram(programs, programs.place(arguments), compile_s)
