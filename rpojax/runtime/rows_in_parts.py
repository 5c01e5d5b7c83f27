"""Rows of arrays in parts, on all cores."""

from collections.abc import Callable, Mapping

import numpy as np

from rpojax.runtime.jax_environment import available_cores
from rpojax.runtime.thread_pools import thread_pool

_MOST_ROWS = 512
"""Rows of a part. NumPy leaves the cores to other threads during its loops, of which small parts have too many."""


def in_parts(function: Callable[[slice], Mapping[str, np.ndarray]], rows: slice) -> dict[str, np.ndarray]:
    """Arrays (rows, ...) by name, of a function that is called for equal parts of some rows, on all cores."""
    count = -(-(rows.stop - rows.start) // _MOST_ROWS)
    if count <= 1:
        return dict(function(rows))
    ends = np.linspace(rows.start, rows.stop, count + 1).astype(int).tolist()
    with thread_pool(min(count, available_cores())) as pool:
        parts = list(pool.map(function, map(slice, ends[:-1], ends[1:])))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
