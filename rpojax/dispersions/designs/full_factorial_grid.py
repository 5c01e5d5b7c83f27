"""Full factorial design: every combination of the listed values of some keys."""

import numpy as np

from rpojax.dispersions.designs.design_kinds import GridDesign
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.dispersions.listed_values import listed_numbers


def grid_size(grid: GridDesign) -> int:
    """Number of combinations."""
    return int(np.prod([len(values) for values in grid.values.values()], dtype=object))


def grid_points(grid: GridDesign, run_range: RunRange) -> dict[str, np.ndarray]:
    """Values (runs, ...) by key; the run number in mixed radix, the last key as last digit, selects the combination."""
    rest = run_range.first_run + np.arange(run_range.runs)
    points = {}
    for key, values in reversed(grid.values.items()):
        rest, digit = np.divmod(rest, len(values))
        points[key] = listed_numbers(values)[digit]
    return points
