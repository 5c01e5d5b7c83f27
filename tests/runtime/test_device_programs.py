"""Calls in one thread per device."""

import itertools
import threading

import pytest

from rpojax.runtime import device_programs


def test_thread_runs_ahead_of_a_slow_one_but_not_far_ahead_of_the_caller() -> None:
    counted, third, released = itertools.count(1), threading.Event(), threading.Event()
    calls: list[int] = []

    def fast() -> int:
        calls.append(next(counted))
        if len(calls) == device_programs.CALLS_AHEAD + 1:
            third.set()
        return calls[-1]

    def slow() -> bool:
        return released.wait(30.0)

    results = device_programs.call_in_threads([fast, slow], 10)
    begun = threading.Thread(target=next, args=(results,))
    begun.start()
    assert third.wait(30.0)  # before the other has its first result
    released.set()
    begun.join()
    results.close()
    assert len(calls) == device_programs.CALLS_AHEAD + 1
    assert list(device_programs.call_in_threads([lambda: next(counted)], 3)) == [[4], [5], [6]]


def test_error_in_a_thread_is_raised_in_the_caller() -> None:
    def fail() -> float:
        raise ValueError("device lost")

    before = set(threading.enumerate())
    with pytest.raises(ValueError, match="device lost"):
        next(device_programs.call_in_threads([lambda: 1.0, fail], 4))
    assert set(threading.enumerate()) <= before
