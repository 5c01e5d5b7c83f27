"""Check of flags that the user gives to XLA, which ends the process at one that it does not know."""

import subprocess
import sys
from typing import Final

from rpojax.errors import RpojaxError

_KNOWN: Final = (
    "--xla_force_host_platform_device_count",
    "--xla_backend_extra_options",
    "--xla_backend_optimization_level",
    "--xla_dump_to",
    "--xla_cpu_enable_fast_math",
    "--xla_gpu_autotune_level",
)
"""Flags that are not tried in a process of their own."""
_PROGRAM: Final = "import jax; jax.devices()"


def check_flags(flags: str) -> None:
    """Refuses the content of XLA_FLAGS if XLA does, tried in a process of its own unless all flags are well known.

    Raises:
        RpojaxError: naming what XLA says.
    """
    if all(word.partition("=")[0] in _KNOWN for word in flags.split()):
        return
    tried = subprocess.run([sys.executable, "-c", _PROGRAM], capture_output=True, text=True, check=False)
    for line in tried.stderr.splitlines() if tried.returncode else ():
        if "XLA_FLAGS" in line:
            raise RpojaxError(f"environment XLA_FLAGS={flags}: found {line.rpartition('] ')[2]}, expected known flags")
