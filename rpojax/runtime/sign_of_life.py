"""Signs of life during long work: a line with its stage and the time so far whenever nothing was shown for a while."""

import threading
import time
from collections.abc import Callable
from types import TracebackType

INTERVAL_S = 5.0
"""Longest silence [s]."""


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
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Ends; no line is shown afterwards."""
        self._ended.set()
        self._thread.join()

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
                self._show(f"{self._stage}, {now - self._begin:.0f} s so far")
