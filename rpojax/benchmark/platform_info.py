"""Machine, backend, package versions and peak memory of a benchmark."""

import os
import platform
import resource
import sys
from pathlib import Path
from typing import Any

import jax

from rpojax.version import __version__


def platform_info() -> dict[str, Any]:
    """Entries of the benchmark's JSON on where it was measured, with the peak memory of the process so far [MiB]."""
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
    """Name of the device, or of the processor with its number of cores."""
    kind = jax.devices()[0].device_kind
    return f"{_processor_name()}, {os.cpu_count()} cores" if kind == "cpu" else kind


def _processor_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
