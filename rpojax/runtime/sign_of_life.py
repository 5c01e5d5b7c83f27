"""Signs of life during long work: a line with its stage and the time so far whenever nothing was shown for a while.

Works may be nested: the innermost one speaks, and those around it speak of what comes before and after it.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType

INTERVAL_S = 3.0
"""Longest silence [s] of a free machine; waiting for a core or for the interpreter adds to it, up to five seconds."""
_OTHERS_TURN_S = 0.1
"""Time after which a work that waits for another one to speak looks again."""


class _LastSign:
    """When something was last shown, by any work."""

    def __init__(self) -> None:
        self.time = time.monotonic()


_last_sign = _LastSign()
_under_way: list[object] = []
"""Works and displays that were begun and have not ended, the innermost one last."""


def note_shown() -> None:
    """Notes that something was shown just now."""
    _last_sign.time = time.monotonic()


@contextmanager
def display() -> Iterator[None]:
    """Context in which a display that moves by itself is on the terminal, so that no sign of life is needed."""
    shown = object()
    _under_way.append(shown)
    try:
        yield
    finally:
        note_shown()
        _end(shown, "the last stage")


def _end(ended: object, stage: str) -> None:
    """Ends a work or display; the one around it goes on after that `stage`."""
    _under_way.remove(ended)
    if _under_way and isinstance(outer := _under_way[-1], SignOfLife):
        outer.describe(f"after {stage}")


class SignOfLife:
    """Thread that shows a line whenever nothing was shown for `INTERVAL_S`, from entry to exit.

    Args:
        show: shows a line
        stage: what is being done, in a few words
    """

    def __init__(self, show: Callable[[str], None], stage: str) -> None:
        self._show, self._stage, self._detail = show, stage, ""
        self._begin = time.monotonic()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> "SignOfLife":
        """Begins to watch."""
        if not _under_way:
            note_shown()
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

    def describe(self, stage: str, detail: str = "") -> None:
        """Says what is being done from now on, and how far it is; a stage counts its time from its begin."""
        if stage != self._stage:
            self._stage, self._begin = stage, time.monotonic()
        self._detail = detail

    def _watch(self) -> None:
        while not self._ended.wait(self._pause_s()):
            now = time.monotonic()
            if now >= _last_sign.time + INTERVAL_S and self._is_innermost():
                note_shown()
                words = f"{self._stage}, {self._detail}" if self._detail else self._stage
                self._show(f"{words}, {now - self._begin:.0f} s so far")

    def _pause_s(self) -> float:
        left = _last_sign.time + INTERVAL_S - time.monotonic()
        return max(left, 0.01 if self._is_innermost() else _OTHERS_TURN_S)

    def _is_innermost(self) -> bool:
        return not _under_way or _under_way[-1] is self
