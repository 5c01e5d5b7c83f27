"""Python's garbage collector, which belongs to the whole process: suspended, or spared the objects that exist."""

import contextlib
import gc
import threading
from collections.abc import Iterator


class _Suspension:
    """Counts the threads that want the collector suspended; the last one resumes it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._holders = 0
        self._was_enabled = False

    def begin(self) -> None:
        with self._lock:
            if self._holders == 0:
                self._was_enabled = gc.isenabled()
                gc.disable()
            self._holders += 1

    def end(self) -> None:
        with self._lock:
            self._holders -= 1
            if self._holders == 0 and self._was_enabled:
                gc.enable()


_SUSPENSION = _Suspension()


@contextlib.contextmanager
def suspended() -> Iterator[None]:
    """Context without garbage collection, in all threads, until the last context of any thread has ended.

    For tracing: it creates millions of live objects, and scanning them takes a fifth of its time.
    """
    _SUSPENSION.begin()
    try:
        yield
    finally:
        _SUSPENSION.end()


@contextlib.contextmanager
def existing_objects_spared() -> Iterator[None]:
    """Context in which the collector does not scan the objects that exist at its begin; its pauses are shorter."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
