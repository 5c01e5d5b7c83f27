"""Signals raise `KeyboardInterrupt`, also where a library swallows the exception of the first one."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress

import pytest

from rpojax.runtime import signal_handling
from rpojax.runtime.signal_handling import Terminated, interrupt_at_signals

KINDS = {signal.SIGINT: KeyboardInterrupt, signal.SIGTERM: Terminated}


class Swallowing:
    """Receives a signal in its destructor, out of which Python lets no exception."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number

    def __del__(self) -> None:
        os.kill(os.getpid(), self.number)
        time.sleep(0.01)


@pytest.fixture(autouse=True)
def restored_handlers() -> Iterator[None]:
    """SIGINT as in a terminal, since it is ignored in the background of a script; all as it was afterwards."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before, hook = {number: signal.getsignal(number) for number in numbers}, sys.unraisablehook
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    sys.unraisablehook = hook
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("number", "words"), [(signal.SIGINT, ("interrupted", 130)), (signal.SIGTERM, ("terminated", 143))]
)
def test_a_signal_is_an_interrupt_with_the_status_of_a_shell(number: signal.Signals, words: tuple[str, int]) -> None:
    interrupt_at_signals()
    with pytest.raises(KeyboardInterrupt) as found:
        os.kill(os.getpid(), number)
        time.sleep(60.0)
    assert found.type is KINDS[number]
    assert signal_handling.ending(found.type) == words


@pytest.mark.parametrize("number", KINDS)
def test_a_signal_in_a_destructor_arrives_after_it_without_a_traceback(
    number: signal.Signals, capfd: pytest.CaptureFixture[str]
) -> None:
    swallowing = [Swallowing(number)]
    interrupt_at_signals()
    with pytest.raises(KeyboardInterrupt) as found:
        swallowing.clear()
        time.sleep(60.0)
    assert found.type is KINDS[number]
    assert capfd.readouterr().err == ""


def test_a_signal_that_a_library_swallows_comes_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signal_handling, "_AGAIN_S", 0.05)
    interrupt_at_signals()
    with suppress(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(60.0)
    with pytest.raises(Terminated):
        time.sleep(60.0)


def test_a_signal_that_is_ignored_stays_ignored() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    interrupt_at_signals()
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.01)


HANGS = """
import os, signal, time
from rpojax.runtime.signal_handling import interrupt_at_signals
interrupt_at_signals()
try:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(60.0)
finally:
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(60.0)
"""


def test_a_second_signal_ends_a_process_that_hangs_at_once() -> None:
    done = subprocess.run([sys.executable, "-c", HANGS], capture_output=True, text=True, timeout=50.0, check=False)
    assert (done.returncode, done.stderr) == (143, "rpojax: terminated at once\n")
