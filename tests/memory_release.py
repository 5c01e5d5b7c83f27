"""Release of memory in a test worker: compilation would otherwise leave several gigabytes behind."""

import ctypes
import gc
import sys
from pathlib import Path

import jax

_GROWTH_BYTES = 150e6
"""Growth after which freed memory goes back to the system."""
_LIMIT_BYTES = 900e6
"""Size above which compiled programs and traces are dropped."""
_GROWTH_TO_DROP_BYTES = 200e6
"""Growth since programs were dropped after which they are dropped again: to look for garbage takes a second."""
_PAGE_BYTES = 4096
_resident_after_last = 0.0
_resident_after_drop = 0.0


def return_freed_memory() -> None:
    """Gives what compilation has freed back to the system; the allocator keeps some 300 MB of each closed loop."""
    global _resident_after_last
    if sys.platform == "linux" and _resident_bytes() > _resident_after_last + _GROWTH_BYTES:
        ctypes.CDLL(None).malloc_trim(0)
        _resident_after_last = _resident_bytes()


def drop_programs() -> None:
    """Drops compiled programs and traces if the process is large; programs that are needed again come from disk."""
    global _resident_after_last, _resident_after_drop
    if _resident_bytes() < max(_LIMIT_BYTES, _resident_after_drop + _GROWTH_TO_DROP_BYTES):
        return
    jax.clear_caches()
    gc.collect()
    _resident_after_last = 0.0
    return_freed_memory()
    _resident_after_drop = _resident_bytes()


def _resident_bytes() -> float:
    statistics = Path("/proc/self/statm")
    return int(statistics.read_text().split()[1]) * _PAGE_BYTES if statistics.exists() else float("inf")
