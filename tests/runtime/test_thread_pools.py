"""A pool of threads lets an interrupt pass at once, and waits for its calls otherwise."""

import threading
from concurrent.futures import Future

import pytest

from rpojax.runtime.thread_pools import thread_pool


def test_an_interrupt_leaves_a_call_that_cannot_be_stopped() -> None:
    end, ended = threading.Event(), threading.Event()
    calls: list[Future[None]] = []

    def compile_for_minutes() -> None:
        end.wait(60.0)
        ended.set()

    with pytest.raises(KeyboardInterrupt), thread_pool(1) as pool:
        calls.extend(pool.submit(compile_for_minutes) for _ in range(2))
        raise KeyboardInterrupt
    assert not ended.is_set()
    assert [call.cancelled() for call in calls] == [False, True]
    end.set()
    assert ended.wait(60.0)


def test_after_an_error_and_at_the_end_all_calls_have_ended() -> None:
    ended: list[int] = []
    with pytest.raises(ValueError, match="too small"), thread_pool(1) as pool:
        pool.submit(threading.Event().wait, 0.05)
        pool.submit(ended.append, 1)
        raise ValueError("too small")
    assert ended == []
    with thread_pool(2) as pool:
        for number in range(10):
            pool.submit(ended.append, number)
    assert sorted(ended) == list(range(10))
