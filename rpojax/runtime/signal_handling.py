"""Signals that end a command: SIGINT and SIGTERM raise `KeyboardInterrupt`, or end the process where none may pass."""

import os
import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any, Final

_AGAIN_S, _AT_ONCE_S = 3.0, 0.001
"""Time after which an exception is raised again [s], since it may have been swallowed, and where it is known to be."""


class Terminated(KeyboardInterrupt):
    """SIGTERM was received."""


_KINDS: Final[dict[int, type[KeyboardInterrupt]]] = {signal.SIGINT: KeyboardInterrupt, signal.SIGTERM: Terminated}


def ending(kind: type[KeyboardInterrupt]) -> tuple[str, int]:
    """What happened to a command, and its exit status, as a shell gives it."""
    return ("terminated", 128 + signal.SIGTERM) if kind is Terminated else ("interrupted", 128 + signal.SIGINT)


def interrupt_at_signals() -> None:
    """Has SIGINT and SIGTERM raise an exception in the main thread, and a second one end the process at once."""
    _handle(lambda number, frame: _interrupt(_KINDS[number], frame))
    sys.unraisablehook = _raise_again


def leave_if_signalled(status: int) -> int:
    """Ends the process at once if a status is that of a signal, else returns the status.

    Python would wait for threads that compile. It also ends by SIGINT if an exception of it passed through a call of
    `exec`, whatever the status is.
    """
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    _handle(signal.SIG_DFL)
    if status - 128 in _KINDS:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    return status


def _handle(handler: Callable[[int, FrameType | None], Any] | signal.Handlers) -> None:
    for number in _KINDS:
        # A job in the background of a script ignores SIGINT.
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


def _interrupt(kind: type[KeyboardInterrupt], frame: FrameType | None) -> None:
    _handle(lambda number, _: _leave(_KINDS[number], "at once"))
    signal.signal(signal.SIGALRM, lambda _, frame: _interrupt(kind, frame))
    signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            # An exception there passes through the initialisation of libraries in C++, which abort the process.
            _leave(kind, "while modules were imported")
        frame = frame.f_back
    raise kind


def _leave(kind: type[KeyboardInterrupt], when: str) -> None:
    word, status = ending(kind)
    clear = "\r\x1b[2K\x1b[?25h" if os.isatty(2) else ""  # a line that is shown live, and the cursor that it hides
    os.write(2, f"{clear}rpojax: {word} {when}\n".encode())
    os._exit(status)


def _raise_again(unraisable: "sys.UnraisableHookArgs") -> None:
    """Raises again what a destructor or a callback of the garbage collector has swallowed, once that has ended."""
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        signal.setitimer(signal.ITIMER_REAL, _AT_ONCE_S)
    else:
        sys.__unraisablehook__(unraisable)
