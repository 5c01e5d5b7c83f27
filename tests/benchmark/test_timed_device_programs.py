"""Functions compiled for several devices."""

import jax
import numpy as np

from rpojax.benchmark.timed_device_programs import compile_for_devices


def test_every_device_gets_its_own_arguments() -> None:
    devices = jax.devices()
    arguments = [(np.float64(number),) for number in range(len(devices))]
    program = compile_for_devices(lambda x: 2.0 * x, arguments, devices)
    assert [float(result) for result in program.run()] == [2.0 * number for number in range(len(devices))]
    assert program.compile_s > 0.0
