"""The design of an experiment: what each run of a campaign is given, worked out once, before anything is compiled.

A design is a function of scenario, seed and the runs that it is made for, all of which `campaign.json` says. So a
resume, a shard and a single run flown again have the values of the campaign.
"""

import hashlib
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rpojax.errors import ResultError, RpojaxError
from rpojax.physics import equipment_faults
from rpojax.scenario import dispersion_keys, schema
from rpojax.scenario.schema import ScenarioFile

_LATIN_HYPERCUBE, _SOBOL = 1, 2
"""Set the random numbers of one design apart from those of another."""
_SOBOL_BITS = 32
MAX_BYTES = 4_000_000_000
"""Memory that a design may take [B]."""
UNIT_MARGIN = 2.0**-53
"""Coordinates keep this distance from 0 and 1, where inverse distributions are infinite."""


@dataclass(frozen=True)
class RunRange:
    """The runs that a design is made for.

    Attributes:
        first_run: number of the first one
        runs: how many there are
    """

    first_run: int
    runs: int


@dataclass(frozen=True)
class Design:
    """What the runs of a population are given.

    Attributes:
        population: the runs
        given: name -> (runs, ...) values in the user's units (table, grid: by key), or coordinates from 0 to 1 (Latin
            hypercube, Sobol: by name of the dispersion); empty where every run draws for itself
    """

    run_range: RunRange
    assigned: dict[str, np.ndarray]

    def for_runs(self, ids: np.ndarray) -> dict[str, np.ndarray]:
        """Rows of the given runs; numbers past the end, which pad a block, get the last row."""
        rows = np.clip(ids - self.run_range.first_run, 0, self.run_range.runs - 1)
        return {name: values[rows] for name, values in self.assigned.items()}

    def record(self) -> dict[str, Any]:
        """What `campaign.json` says of it: the population, and the SHA-256 of what is given."""
        digest = hashlib.sha256()
        for name, values in sorted(self.assigned.items()):
            digest.update(name.encode() + b"\0" + np.ascontiguousarray(values, dtype="<f8").tobytes())
        return {**asdict(self.run_range), "sha256": digest.hexdigest()}


def has_independent_runs(file: ScenarioFile) -> bool:
    """Whether the runs of a campaign are independent draws, as exact intervals and order statistics need them."""
    return file.design.kind == "independent"


def make_design(file: ScenarioFile, seed: int, run_range: RunRange) -> Design:
    """Design of a checked scenario for some runs.

    Raises:
        RpojaxError: a table or grid has fewer runs.
    """
    check_size(file, run_range)
    match file.design:
        case schema.LatinHypercubeDesign():
            return Design(run_range, _latin_hypercube(file, seed, run_range))
        case schema.SobolDesign():
            return Design(run_range, _sobol(file, seed, run_range))
        case schema.TableDesign():
            rows = run_range.first_run + np.arange(run_range.runs)
            return Design(run_range, {key: _as_numbers(values)[rows] for key, values in file.design.values.items()})
        case schema.GridDesign():
            return Design(run_range, _grid(file.design, run_range))
        case schema.IndependentDesign():
            return Design(run_range, {})


def check_size(file: ScenarioFile, run_range: RunRange) -> None:
    """Refuses more runs than a table has rows, or a grid points, and designs that take too much memory.

    Raises:
        RpojaxError: saying how many runs there can be.
    """
    if dispersion_keys.design_bytes(file, run_range.runs) > MAX_BYTES:
        most = MAX_BYTES // dispersion_keys.design_bytes(file, 1)
        raise RpojaxError(f"--runs: found {run_range.runs}, expected at most {most} for this design")
    sizes = [len(values) for values in getattr(file.design, "values", {}).values()]
    if not sizes:
        return
    table = isinstance(file.design, schema.TableDesign)
    size = sizes[0] if table else int(np.prod(sizes, dtype=object))
    if run_range.first_run + run_range.runs > size:
        last = run_range.first_run + run_range.runs - 1
        what = "the table of the design has rows" if table else "the grid of the design has points"
        raise RpojaxError(f"--runs: found run {last}, expected runs up to {size - 1}: {what} for no more")


def _latin_hypercube(file: ScenarioFile, seed: int, run_range: RunRange) -> dict[str, np.ndarray]:
    """Of every coordinate one value in each of `runs` equal parts of 0 to 1, in random order.

    Each dispersion has its own stream, so adding one leaves the others as they were (McKay, Beckman and Conover, 1979).
    """
    given = {}
    for entry in file.dispersions:
        if count := dispersion_keys.coordinate_count(file, entry):
            name = dispersion_keys.dispersion_name(entry)
            entropy = [_LATIN_HYPERCUBE, seed, zlib.crc32(name.encode()), run_range.first_run, run_range.runs]
            rng = np.random.default_rng(entropy)
            shape = (run_range.runs, count)
            strata = rng.random(shape).argsort(axis=0)
            given[name] = _inside_unit_interval((strata + rng.random(shape)) / run_range.runs)
    return given


def _sobol(file: ScenarioFile, seed: int, run_range: RunRange) -> dict[str, np.ndarray]:
    """Points of a scrambled Sobol sequence, run `i` at point `i`: more runs leave the earlier ones as they were.

    Coordinates are taken in the order of the dispersions; adding one gives all others another scrambling.
    """
    from scipy.stats import qmc

    counts = {
        dispersion_keys.dispersion_name(entry): dispersion_keys.coordinate_count(file, entry)
        for entry in file.dispersions
    }
    total = sum(counts.values())
    if total == 0:
        return {}
    sequence = qmc.Sobol(total, bits=_SOBOL_BITS, rng=np.random.default_rng([_SOBOL, seed]))
    if run_range.first_run:
        sequence.fast_forward(run_range.first_run)
    # One point first: a sequence that begins with another number than a power of two warns of what the user chose.
    points = np.concatenate([sequence.random(1), sequence.random(run_range.runs - 1)])
    # Points lie at the lower ends of their cells; the middle is inside.
    points = _inside_unit_interval(points + 0.5 * 2.0**-_SOBOL_BITS)
    ends = np.cumsum(list(counts.values()))
    parts = zip(counts, counts.values(), ends, strict=True)
    return {name: points[:, end - count : end] for name, count, end in parts if count}


def _inside_unit_interval(coordinates: np.ndarray) -> np.ndarray:
    return np.clip(coordinates, UNIT_MARGIN, 1.0 - UNIT_MARGIN)


def _grid(grid: schema.GridDesign, run_range: RunRange) -> dict[str, np.ndarray]:
    """Values of some runs: a run's number, in mixed radix with the last key as last digit, says which ones."""
    rest = run_range.first_run + np.arange(run_range.runs)
    given = {}
    for key, values in reversed(grid.values.items()):
        rest, digit = np.divmod(rest, len(values))
        given[key] = _as_numbers(values)[digit]
    return given


def _as_numbers(values: list[Any]) -> np.ndarray:
    """Values as numbers; kinds of fault by their codes."""
    return np.array([equipment_faults.kind_code(value) for value in values], dtype=np.float64)


def recorded_run_range(info: Mapping[str, Any]) -> RunRange:
    """Runs for which the design of a campaign was made, by the content of its `campaign.json`.

    Raises:
        ResultError: it does not say so, or says what cannot be.
    """
    recorded = info.get("design", {"first_run": info["first_run"], "runs": info["runs"]})
    numbers = [recorded.get(name) for name in ("first_run", "runs")] if isinstance(recorded, dict) else [None, None]
    first, runs = numbers
    if type(first) is not int or type(runs) is not int or first < 0 or runs < 1:
        raise ResultError(f"campaign.json: found {recorded!r:.80} for 'design', expected first_run and runs")
    if info["first_run"] < first or info["first_run"] + info["runs"] > first + runs:
        held = f"runs {info['first_run']} to {info['first_run'] + info['runs'] - 1}"
        raise ResultError(f"campaign.json: found {held}, expected runs of its design, {first} to {first + runs - 1}")
    return RunRange(first, runs)


def recreate_design(file: ScenarioFile, info: Mapping[str, Any]) -> Design:
    """Design of a campaign that was begun, by the content of its `campaign.json`.

    Raises:
        ResultError: the design is not what it was when the campaign began.
    """
    found = make_design(file, info["seed"], recorded_run_range(info))
    recorded = info.get("design", {}).get("sha256")
    if recorded is not None and recorded != found.record()["sha256"]:
        raise ResultError(
            "campaign.json: found another design for its scenario and seed, expected that of its beginning"
        )
    return found
