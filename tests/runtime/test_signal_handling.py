"""Signals that a library swallows: the exception comes again, at once, and nothing is printed of the first one."""

import os
import signal
import time
from collections.abc import Iterator

import pytest

from rpojax.runtime.signal_handling import ending_signals


class Swallowing:
    """Receives an interrupt in its destructor, out of which Python lets no exception."""

    def __del__(self) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)


@pytest.fixture
def heard_interrupts() -> Iterator[None]:
    """SIGINT as in a terminal; in the background of a script it is ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heard_interrupts")
def test_an_interrupt_in_a_destructor_arrives_after_it_without_a_traceback(capfd: pytest.CaptureFixture[str]) -> None:
    swallowing = [Swallowing()]
    with ending_signals() as received, pytest.raises(KeyboardInterrupt):
        swallowing.clear()
        time.sleep(60.0)
    assert received.number == signal.SIGINT
    assert capfd.readouterr().err == ""
