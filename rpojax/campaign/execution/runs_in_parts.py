"""Evaluation of the records of many runs on all cores, as blocks of an accelerator have them."""

from collections.abc import Callable, Mapping

import numpy as np

from rpojax.core.pytree import concatenate
from rpojax.runtime.jax_environment import available_cores
from rpojax.runtime.thread_pools import thread_pool

_MOST_RUNS = 512
"""Runs of a part. NumPy leaves the cores to other threads during its loops, of which small parts have too many."""


def in_parts(function: Callable[[slice], Mapping[str, np.ndarray]], rows: slice) -> dict[str, np.ndarray]:
    """Arrays (runs, ...) by name for runs `rows`, by a function that is called for equal parts of them in threads."""
    count = -(-(rows.stop - rows.start) // _MOST_RUNS)
    if count <= 1:
        return dict(function(rows))
    ends = np.linspace(rows.start, rows.stop, count + 1).astype(int).tolist()
    with thread_pool(min(count, available_cores())) as pool:
        return concatenate([dict(part) for part in pool.map(function, map(slice, ends[:-1], ends[1:]))])
