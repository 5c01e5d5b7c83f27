"""Design by a table of cases: one row of listed values for each run."""

import numpy as np

from rpojax.dispersions.designs.design_kinds import TableDesign
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.physics import equipment_faults


def table_size(table: TableDesign) -> int:
    """Number of rows."""
    return len(next(iter(table.values.values())))


def table_rows(table: TableDesign, run_range: RunRange) -> dict[str, np.ndarray]:
    """Values (runs,) by key; run `i` has row `i`."""
    rows = run_range.first_run + np.arange(run_range.runs)
    return {
        key: np.array([equipment_faults.kind_code(value) for value in values], dtype=np.float64)[rows]
        for key, values in table.values.items()
    }
