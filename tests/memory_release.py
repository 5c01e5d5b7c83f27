"""Release of memory in a test worker: compiled programs would otherwise accumulate to several gigabytes."""

import ctypes
import gc
import sys
from pathlib import Path

import jax

_LIMIT_BYTES = 700e6
_PAGE_BYTES = 4096


def release_memory() -> None:
    """Drops compiled programs and traces if the process is large; programs that are needed again come from disk."""
    if _resident_bytes() < _LIMIT_BYTES:
        return
    jax.clear_caches()
    gc.collect()
    if sys.platform == "linux":
        ctypes.CDLL(None).malloc_trim(0)  # freed memory goes back to the system


def _resident_bytes() -> float:
    statistics = Path("/proc/self/statm")
    return int(statistics.read_text().split()[1]) * _PAGE_BYTES if statistics.exists() else float("inf")
