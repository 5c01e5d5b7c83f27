"""The parts of `rpojax bench`, and what their figures hang on: machine, versions, memory."""

import os
import platform
import resource
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import jax

from rpojax.benchmark import closed_loop_speed, filter_speed, orbit_speed, vision_speed
from rpojax.scenario.schema import ScenarioFile
from rpojax.version import __version__


def _kernels(file: ScenarioFile, _: Sequence[int]) -> dict[str, Any]:
    return {"kernels": {"orbit": asdict(orbit_speed.measure()), "filter": filter_speed.measure(file)}}


def _vision(_: ScenarioFile, __: Sequence[int]) -> dict[str, Any]:
    return {"vision": asdict(vision_speed.measure())}


PARTS: Mapping[str, Callable[[ScenarioFile, Sequence[int]], dict[str, Any]]] = {
    "loop": closed_loop_speed.measure,
    "kernels": _kernels,
    "vision": _vision,
}
"""Name of a part -> what measures it, given a scenario and the batch sizes of the closed loop."""


def platform_info() -> dict[str, Any]:
    """Where figures were measured, and the most memory that the process has had so far [MiB]."""
    return {
        "peak_memory_mib": _peak_memory_mib(),
        "machine": processor_description(),
        "backend": jax.default_backend(),
        "versions": {"rpojax": __version__, "jax": jax.__version__, "python": platform.python_version()},
    }


def _peak_memory_mib() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def processor_description() -> str:
    """Name of the device, or of the processor and its number of cores."""
    kind = jax.devices()[0].device_kind
    return f"{_processor()}, {os.cpu_count()} cores" if kind == "cpu" else kind


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
