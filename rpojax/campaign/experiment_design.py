"""Experiment design of a campaign: the values or unit-cube coordinates of its runs, computed before compilation.

A design is a function of scenario, seed and run range, all recorded in `campaign.json`, so that a resumed campaign, a
part of one and the replay of one run use the values of the whole campaign.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rpojax.dispersions.designs.design_sections import (
    GridDesign,
    IndependentDesign,
    LatinHypercubeDesign,
    SobolDesign,
    TableDesign,
)
from rpojax.dispersions.designs.latin_hypercube import latin_hypercube
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.dispersions.designs.sobol_sequence import sobol_sequence
from rpojax.dispersions.designs.table_and_grid import grid_points, grid_size, table_rows, table_size
from rpojax.errors import ResultError, RpojaxError
from rpojax.scenario.dispersed_numbers.dispersion_keys import coordinate_count, design_keys
from rpojax.scenario.former_fault import former_name
from rpojax.scenario.parameter_keys import nominal_value, parse_key
from rpojax.scenario.schema import ScenarioFile

MAX_BYTES = 4_000_000_000
"""Largest memory of a design [B]."""


@dataclass(frozen=True)
class Design:
    """What a design assigns to its runs.

    Attributes:
        run_range: the runs
        assigned: name -> (runs, ...) values in the unit of the key (table, grid: by key), or coordinates in (0, 1)
            (Latin hypercube, Sobol: by name of the dispersion); empty for independent runs
    """

    run_range: RunRange
    assigned: dict[str, np.ndarray]

    def for_runs(self, ids: np.ndarray) -> dict[str, np.ndarray]:
        """Rows of the runs `ids`; numbers past the end, which pad a block, get the last row."""
        rows = np.clip(ids - self.run_range.first_run, 0, self.run_range.runs - 1)
        return {name: values[rows] for name, values in self.assigned.items()}

    def sha256(self) -> str:
        """Digest of the assigned values, as `campaign.json` records it."""
        digest = hashlib.sha256()
        for name, values in sorted(self.assigned.items()):
            digest.update(name.encode() + b"\0" + np.ascontiguousarray(values, dtype="<f8").tobytes())
        return digest.hexdigest()


def has_independent_runs(file: ScenarioFile) -> bool:
    """Whether runs are independent random samples, as exact intervals and order statistics require."""
    return file.design.kind == "independent"


def make_design(file: ScenarioFile, seed: int, run_range: RunRange) -> Design:
    """Design of a validated scenario for some runs.

    Raises:
        RpojaxError: a table or grid has fewer runs, or the design takes too much memory.
    """
    check_size(file, run_range)
    names = {former_name(entry.name): entry.name for entry in file.dispersions}
    counts = {former_name(entry.name): coordinate_count(file, entry) for entry in file.dispersions}
    match file.design:
        case LatinHypercubeDesign():
            return Design(run_range, _renamed(latin_hypercube(counts, seed, run_range), names))
        case SobolDesign():
            return Design(run_range, _renamed(sobol_sequence(counts, seed, run_range), names))
        case TableDesign():
            return Design(run_range, table_rows(file.design, run_range))
        case GridDesign():
            return Design(run_range, grid_points(file.design, run_range))
        case IndependentDesign():
            return Design(run_range, {})


def _renamed(coordinates: Mapping[str, np.ndarray], names: Mapping[str, str]) -> dict[str, np.ndarray]:
    return {names[name]: values for name, values in coordinates.items()}


def check_size(file: ScenarioFile, run_range: RunRange) -> None:
    """Refuses more runs than a table has rows or a grid has points, and designs that take too much memory.

    Raises:
        RpojaxError: saying how many runs are possible.
    """
    if design_bytes(file, run_range.runs) > MAX_BYTES:
        most = MAX_BYTES // design_bytes(file, 1)
        raise RpojaxError.of_argument("runs", f"found {run_range.runs}, expected at most {most} for this design")
    match file.design:
        case TableDesign():
            size, reason = table_size(file.design), "the table of the design has rows"
        case GridDesign():
            size, reason = grid_size(file.design), "the grid of the design has points"
        case _:
            return
    last = run_range.first_run + run_range.runs - 1
    if last >= size:
        raise RpojaxError.of_argument("runs", f"found run {last}, expected runs up to {size - 1}: {reason} for no more")


def design_bytes(file: ScenarioFile, runs: int) -> int:
    """Memory of a design of `runs` runs [B]."""
    if isinstance(file.design, LatinHypercubeDesign | SobolDesign):
        count = sum(coordinate_count(file, entry) for entry in file.dispersions)
    else:
        count = sum(np.size(nominal_value(file, parse_key(text))) for text in design_keys(file))
    return 8 * runs * count


def recreate_design(file: ScenarioFile, seed: int, run_range: RunRange, sha256: str | None) -> Design:
    """Design of a recorded campaign with the recorded digest, None if there is none.

    Raises:
        ResultError: the design differs from the recorded one.
    """
    design = make_design(file, seed, run_range)
    if sha256 is not None and sha256 != design.sha256():
        raise ResultError(
            "campaign.json: found another design for its scenario and seed, expected that of its beginning"
        )
    return design
