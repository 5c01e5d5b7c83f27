"""Signs of life during long work: a line with its stage and the time so far whenever nothing was shown for a while.

Works may be nested: the innermost one speaks, and those around it speak of what comes before and after it.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType

INTERVAL_S = 4.0
"""Longest silence [s]; a busy machine and the begin of a process add to it, and five seconds are the bar."""

_under_way: list[object] = []
"""Works and displays that were begun and have not ended, the innermost one last."""


@contextmanager
def display() -> Iterator[None]:
    """Context in which a display that moves by itself is on the terminal, so that no sign of life is needed."""
    shown = object()
    _under_way.append(shown)
    try:
        yield
    finally:
        _end(shown, "the last stage")


def _end(ended: object, stage: str) -> None:
    """Ends a work or display; the one around it goes on after that `stage`."""
    _under_way.remove(ended)
    if _under_way and isinstance(outer := _under_way[-1], SignOfLife):
        outer.note(f"after {stage}")


class SignOfLife:
    """Thread that shows a line whenever nothing was shown for `INTERVAL_S`, from entry to exit.

    Args:
        show: shows a line
        stage: what is being done, in a few words
    """

    def __init__(self, show: Callable[[str], None], stage: str) -> None:
        self._show, self._stage = show, stage
        self._begin = self._last = time.monotonic()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> "SignOfLife":
        """Begins to watch."""
        _under_way.append(self)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Ends; no line is shown afterwards."""
        self._ended.set()
        self._thread.join()
        _end(self, self._stage)

    def note(self, stage: str | None = None) -> None:
        """Notes that something else was shown just now, and the stage that began."""
        self._last = time.monotonic()
        if stage is not None and stage != self._stage:
            self._stage, self._begin = stage, self._last

    def _watch(self) -> None:
        while not self._ended.wait(max(0.01, self._last + INTERVAL_S - time.monotonic())):
            now = time.monotonic()
            if now >= self._last + INTERVAL_S:
                self._last = now
                if not _under_way or _under_way[-1] is self:
                    self._show(f"{self._stage}, {now - self._begin:.0f} s so far")
