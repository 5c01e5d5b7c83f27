"""Designs of listed values: one row of a table for each run, or every combination of the values of some keys."""

import numpy as np

from rpojax.dispersions.designs.design_sections import GridDesign, TableDesign
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.dispersions.listed_values import listed_numbers


def table_size(table: TableDesign) -> int:
    """Number of rows."""
    return len(next(iter(table.values.values())))


def table_rows(table: TableDesign, run_range: RunRange) -> dict[str, np.ndarray]:
    """Values (runs,) by key; run `i` has row `i`."""
    rows = run_range.first_run + np.arange(run_range.runs)
    return {key: listed_numbers(values)[rows] for key, values in table.values.items()}


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
