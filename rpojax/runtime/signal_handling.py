"""Signals that end a command: SIGINT and SIGTERM raise `KeyboardInterrupt`, or end the process where none may pass."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

_AGAIN_S: Final = 0.001
"""Time after which an exception that was swallowed is raised again [s]; zero would be no timer."""


class Terminated(KeyboardInterrupt):
    """SIGTERM was received."""


_INTERRUPTS: Final[dict[int, type[KeyboardInterrupt]]] = {signal.SIGINT: KeyboardInterrupt, signal.SIGTERM: Terminated}


def exit_status(interrupt: KeyboardInterrupt) -> int:
    """Exit status of a command, as a shell gives it."""
    return 128 + (signal.SIGTERM if isinstance(interrupt, Terminated) else signal.SIGINT)


def describe(interrupt: KeyboardInterrupt) -> str:
    """What happened to a command."""
    return "terminated" if isinstance(interrupt, Terminated) else "interrupted"


def end_at_signals() -> None:
    """Ends the process at SIGINT and SIGTERM, while modules are imported, when an exception could be swallowed."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda number, _: _leave(_INTERRUPTS[number](), "; nothing was written"))


def _leave(interrupt: KeyboardInterrupt, words: str) -> None:
    clear = "\r\x1b[2K\x1b[?25h" if os.isatty(2) else ""  # a line that is shown live, and the cursor that it hides
    os.write(2, f"{clear}rpojax: {describe(interrupt)}{words}\n".encode())
    os._exit(exit_status(interrupt))


def leave_if_signalled(status: int) -> int:
    """Ends the process at once if a status is that of a signal, else returns the status.

    Python would wait for threads that compile. It also ends by SIGINT if an exception of it passed through a call of
    `exec`, whatever the status is.
    """
    if status in (128 + signal.SIGINT, 128 + signal.SIGTERM):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    return status


@contextmanager
def ending_signals() -> Iterator[None]:
    """Raises `KeyboardInterrupt` in the body at SIGINT and SIGTERM; in other threads than the main one nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    swallowed = KeyboardInterrupt

    def end(number: int, frame: FrameType | None) -> None:
        kind = _INTERRUPTS.get(number, swallowed)
        if _is_importing(frame):
            # An exception there passes through the initialisation of libraries in C++, which abort the process.
            _leave(kind(), " while modules were imported")
        raise kind

    def raise_again(unraisable: "sys.UnraisableHookArgs") -> None:
        # A callback of the garbage collector or a destructor swallows exceptions.
        nonlocal swallowed
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            swallowed = unraisable.exc_type
            signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
        else:
            hook(unraisable)

    hook, before = sys.unraisablehook, {number: signal.getsignal(number) for number in (*_INTERRUPTS, signal.SIGALRM)}
    try:
        for number, handler in before.items():
            # A job in the background of a script ignores SIGINT.
            if handler != signal.SIG_IGN:
                signal.signal(number, end)
        sys.unraisablehook = raise_again
        yield
    finally:
        sys.unraisablehook = hook
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)


def _is_importing(frame: FrameType | None) -> bool:
    """Whether a frame is part of the import of a module."""
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False
