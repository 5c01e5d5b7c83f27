"""Signals raise `KeyboardInterrupt`, also where a library swallows the exception of the first one."""

import os
import signal
import time
from collections.abc import Iterator

import pytest

from rpojax.runtime import signal_handling
from rpojax.runtime.signal_handling import Terminated, ending_signals

KINDS = {signal.SIGINT: KeyboardInterrupt, signal.SIGTERM: Terminated}


class Swallowing:
    """Receives a signal in its destructor, out of which Python lets no exception."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number

    def __del__(self) -> None:
        os.kill(os.getpid(), self.number)
        time.sleep(0.01)


@pytest.fixture(autouse=True)
def heard_interrupts() -> Iterator[None]:
    """SIGINT as in a terminal; in the background of a script it is ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(
    ("number", "words"), [(signal.SIGINT, (130, "interrupted")), (signal.SIGTERM, (143, "terminated"))]
)
def test_a_signal_is_an_interrupt_with_the_status_of_a_shell(number: signal.Signals, words: tuple[int, str]) -> None:
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)}
    with pytest.raises(KeyboardInterrupt) as found, ending_signals():
        os.kill(os.getpid(), number)
        time.sleep(60.0)
    assert found.type is KINDS[number]
    assert (signal_handling.exit_status(found.value), signal_handling.describe(found.value)) == words
    assert {each: signal.getsignal(each) for each in before} == before


@pytest.mark.parametrize("number", KINDS)
def test_a_signal_in_a_destructor_arrives_after_it_without_a_traceback(
    number: signal.Signals, capfd: pytest.CaptureFixture[str]
) -> None:
    swallowing = [Swallowing(number)]
    with pytest.raises(KeyboardInterrupt) as found, ending_signals():
        swallowing.clear()
        time.sleep(60.0)
    assert found.type is KINDS[number]
    assert capfd.readouterr().err == ""


def test_a_signal_that_is_ignored_stays_ignored() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with ending_signals():
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
