"""The garbage collector is suspended while any thread traces, and resumes as it was."""

import gc
import threading
from collections.abc import Iterator

import pytest

from rpojax.runtime import garbage_collection


@pytest.fixture(autouse=True)
def collector() -> Iterator[None]:
    before = gc.isenabled()
    gc.enable()
    yield
    (gc.enable if before else gc.disable)()


def test_collector_resumes_after_success_and_failure() -> None:
    with garbage_collection.suspended():
        assert not gc.isenabled()
    assert gc.isenabled()
    with pytest.raises(ZeroDivisionError), garbage_collection.suspended():
        raise ZeroDivisionError
    assert gc.isenabled()


def test_collector_that_the_caller_has_disabled_stays_disabled() -> None:
    gc.disable()
    with garbage_collection.suspended():
        assert not gc.isenabled()
    assert not gc.isenabled()


def test_collector_resumes_when_the_last_of_overlapping_threads_has_ended() -> None:
    """The first thread to begin is the first to end."""
    begun, overlapping, ended = threading.Event(), threading.Event(), threading.Event()

    def first() -> None:
        with garbage_collection.suspended():
            begun.set()
            overlapping.wait(30.0)
        ended.set()

    thread = threading.Thread(target=first)
    thread.start()
    assert begun.wait(30.0)
    with garbage_collection.suspended():
        overlapping.set()
        assert ended.wait(30.0)
        assert not gc.isenabled()
    thread.join()
    assert gc.isenabled()
