"""Design by a table of cases: one row of listed values for each run."""

import numpy as np

from rpojax.dispersions.designs.design_kinds import TableDesign
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.dispersions.listed_values import listed_numbers


def table_size(table: TableDesign) -> int:
    """Number of rows."""
    return len(next(iter(table.values.values())))


def table_rows(table: TableDesign, run_range: RunRange) -> dict[str, np.ndarray]:
    """Values (runs,) by key; run `i` has row `i`."""
    rows = run_range.first_run + np.arange(run_range.runs)
    return {key: listed_numbers(values)[rows] for key, values in table.values.items()}
