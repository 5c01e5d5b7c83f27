"""A pool of threads lets an interrupt pass at once, and waits for its calls otherwise; rows in parts, in threads."""

import threading
from concurrent.futures import Future

import numpy as np
import pytest

from rpojax.runtime import thread_pools
from rpojax.runtime.thread_pools import in_parts, thread_pool


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


@pytest.mark.parametrize(("first", "last", "parts"), [(0, 5, 1), (100, 612, 1), (100, 613, 2), (7, 2100, 5)])
def test_parts_join_to_all_rows_in_order(first: int, last: int, parts: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thread_pools, "available_cores", lambda: 3)
    values = np.random.default_rng(1).normal(size=(2200, 2))
    seen: list[slice] = []

    def squares(rows: slice) -> dict[str, np.ndarray]:
        seen.append(rows)
        return {"square": values[rows] ** 2, "number": np.arange(rows.start, rows.stop)}

    found = in_parts(squares, slice(first, last))
    np.testing.assert_array_equal(found["square"], values[first:last] ** 2)
    np.testing.assert_array_equal(found["number"], np.arange(first, last))
    assert len(seen) == parts
    assert max(rows.stop - rows.start for rows in seen) <= 512


def test_parts_run_at_the_same_time_and_an_error_of_one_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thread_pools, "available_cores", lambda: 2)
    both = threading.Barrier(2, timeout=60.0)

    def meet(rows: slice) -> dict[str, np.ndarray]:
        both.wait()
        if rows.start:
            raise ValueError("of the second part")
        return {"row": np.arange(rows.start, rows.stop)}

    with pytest.raises(ValueError, match="of the second part"):
        in_parts(meet, slice(0, 1000))
