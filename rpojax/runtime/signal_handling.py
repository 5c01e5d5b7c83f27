"""Signals that end a command: an exception in the main thread, raised again where a library swallowed it."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

_AGAIN_S: Final = 3.0
"""Time after which an exception that did not arrive is raised again [s]; cleaning up takes less."""
_AT_ONCE_S: Final = 0.001
"""The same where it is known to have been swallowed [s]; zero would be no timer."""


class Received:
    """The signal that ended a command.

    Attributes:
        number: of the signal, None if there was none
    """

    def __init__(self) -> None:
        self.number: int | None = None

    @property
    def word(self) -> str:
        """What happened to the command."""
        return "terminated" if self.number == signal.SIGTERM else "interrupted"

    @property
    def status(self) -> int:
        """Exit status of the command, as a shell gives it."""
        return 128 + (self.number or signal.SIGINT)


def end_at_signals() -> None:
    """Ends the process at SIGINT and SIGTERM, while modules are imported, when an exception could be swallowed."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _end)


def _end(number: int, _: FrameType | None) -> None:
    word = "interrupted" if number == signal.SIGINT else "terminated"
    os.write(2, f"rpojax: {word}; nothing was written\n".encode())
    os._exit(128 + number)


def _is_importing(frame: FrameType | None) -> bool:
    """Whether a frame is part of the import of a module."""
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False


def leave_if_signalled(status: int) -> int:
    """Ends the process at once if a status is that of a signal, else returns the status.

    Python itself ends by SIGINT if an exception of it passed through a call of `exec`, whatever the status is.
    """
    if status in (128 + signal.SIGINT, 128 + signal.SIGTERM):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    return status


@contextmanager
def ending_signals() -> Iterator[Received]:
    """Raises `KeyboardInterrupt` in the body at SIGINT and SIGTERM; in other threads than the main one nothing."""
    received = Received()
    if threading.current_thread() is not threading.main_thread():
        yield received
        return

    def note(number: int, frame: FrameType | None) -> None:
        received.number = number if number != signal.SIGALRM else received.number
        if _is_importing(frame):
            # An exception there passes through the initialisation of libraries in C++, which abort the process.
            os.write(2, f"rpojax: {received.word} while modules were imported\n".encode())
            os._exit(received.status)
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
        raise KeyboardInterrupt

    def silent(unraisable: "sys.UnraisableHookArgs") -> None:
        # A callback of the garbage collector or a destructor swallowed it: it is raised again at once.
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, _AT_ONCE_S)
        else:
            hook(unraisable)

    hook = sys.unraisablehook
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        for number in numbers:
            # A job in the background of a script ignores SIGINT.
            if before[number] != signal.SIG_IGN:
                signal.signal(number, note)
        sys.unraisablehook = silent
        yield received
    finally:
        sys.unraisablehook = hook
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
