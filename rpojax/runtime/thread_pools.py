"""Threads: pools that do not hold back an interrupt, as a compilation cannot be stopped, only left; rows in parts."""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np

from rpojax.runtime.jax_environment import available_cores

_MOST_ROWS = 512
"""Rows of a part. NumPy leaves the cores to other threads during its loops, of which small parts have too many."""


@contextmanager
def thread_pool(threads: int) -> Iterator[ThreadPoolExecutor]:
    """A pool for the body; an error drops the calls that wait, and an interrupt also leaves those under way."""
    pool = ThreadPoolExecutor(threads)
    try:
        yield pool
    except BaseException as error:
        pool.shutdown(wait=not isinstance(error, KeyboardInterrupt), cancel_futures=True)
        raise
    pool.shutdown()


def in_parts(function: Callable[[slice], Mapping[str, np.ndarray]], rows: slice) -> dict[str, np.ndarray]:
    """Arrays (rows, ...) by name, of a function that is called for equal parts of some rows, on all cores."""
    count = -(-(rows.stop - rows.start) // _MOST_ROWS)
    if count <= 1:
        return dict(function(rows))
    ends = np.linspace(rows.start, rows.stop, count + 1).astype(int).tolist()
    with thread_pool(min(count, available_cores())) as pool:
        parts = list(pool.map(function, map(slice, ends[:-1], ends[1:])))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
