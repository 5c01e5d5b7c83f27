"""Study of faults: which single or double faults, at which times, the runs of a scenario survive."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from rpojax.analysis.robustness.assigned_runs import AssignedRuns, StudyProgress, check_study, provenance
from rpojax.analysis.robustness.step_runs import requirement_names
from rpojax.analysis.statistics.intervals import clopper_pearson_interval
from rpojax.campaign.storage.atomic_outputs import to_json_types
from rpojax.errors import RpojaxError, ScenarioError
from rpojax.metrics.metric_catalogue import UNITS
from rpojax.physics.equipment_faults import KINDS, LEAKS
from rpojax.runtime.progress import run_progress
from rpojax.scenario.dispersed_numbers.dispersion_keys import assigned_keys
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.loading.table_merging import apply_override
from rpojax.scenario.schema import RequirementSection, ScenarioFile
from rpojax.simulation.outcomes.outcome_kinds import Outcome, count_outcomes, is_failed, is_frozen
from rpojax.simulation.outcomes.requirement_violations import counts, required_values, violates

DEFAULT_RUNS: Final = 32
_PARTS: Final = 4
"""Parts of a run at whose ends faults begin by default."""
_MOST_RUNS: Final = 500_000
_AT_ONCE: Final = 16
"""Cells that a batch holds, if the device can."""
_NAMES: Final = ("injected", "second")
"""Names of the faults of a study where the scenario has none."""
_SENSORS: Final = ("gps_outage", "star_tracker_blind", "camera_blackout")
_OF_ONE_THRUSTER: Final = ("thruster_off", "thruster_weak")
_CHOSEN: Final = ("kind", "start_s", "wheel", "thruster")
"""Keys of a fault that the study chooses; severity and duration are the scenario's."""


@dataclass(frozen=True)
class EquipmentFault:
    """A kind of fault of one piece of equipment.

    Attributes:
        kind: of `KINDS`
        equipment: that fails, in words
        wheel: its index, 0 for other equipment
        thruster: its number, 0 for other equipment
    """

    kind: str
    equipment: str
    wheel: int = 0
    thruster: int = 0

    @property
    def title(self) -> str:
        """The fault in words."""
        words = self.kind.replace("_", " ")
        return words if self.kind in _SENSORS else f"{words}: {self.equipment}"


def single_faults(file: ScenarioFile) -> list[EquipmentFault]:
    """Every kind of fault of every piece of equipment of a scenario with one servicer."""
    wheels = [
        EquipmentFault(kind, f"wheel {k}", wheel=k) for kind in ("wheel_stuck", "wheel_friction") for k in range(3)
    ]
    names = sorted(each.name for each in file.thrusters)
    kinds = (*_OF_ONE_THRUSTER, *LEAKS) if names else _OF_ONE_THRUSTER
    thrusters = [
        EquipmentFault(kind, name, thruster=number)
        for kind in kinds
        for number, name in enumerate(names or ["thruster"])
    ]
    return [*wheels, *thrusters, *(EquipmentFault(kind, kind) for kind in _SENSORS)]


def fault_sets(file: ScenarioFile, is_double: bool) -> list[tuple[EquipmentFault, ...]]:
    """Faults that are injected together: each alone, or each two of different equipment."""
    singles = single_faults(file)
    if not is_double:
        return [(each,) for each in singles]
    return [(one, two) for one, two in itertools.combinations(singles, 2) if one.equipment != two.equipment]


@dataclass(frozen=True)
class Cell:
    """Faults that begin at one time [s]."""

    faults: tuple[EquipmentFault, ...]
    time_s: float


@dataclass(frozen=True)
class Injection:
    """The scenario of a study, in which some of its faults are those that the study chooses.

    Attributes:
        file: with as many faults as are injected together, all of the kind `none`
        names: of the faults that are chosen
        settings: `KEY=VALUE` that make it of the scenario that is studied
    """

    file: ScenarioFile
    names: tuple[str, ...]
    settings: tuple[str, ...]

    @property
    def keys(self) -> list[str]:
        """Keys that cells change."""
        return [f"faults.{name}.{key}" for name in self.names for key in _CHOSEN]

    def values(self, cell: Cell, runs: int) -> dict[str, np.ndarray]:
        """Values (runs,) of a cell by key."""
        found = {}
        for name, fault in zip(self.names, cell.faults, strict=False):
            chosen = (KINDS.index(fault.kind), cell.time_s, fault.wheel, fault.thruster)
            for key, value in zip(_CHOSEN, chosen, strict=True):
                found[f"faults.{name}.{key}"] = np.full(runs, float(value))
        return found

    def settings_of(self, cell: Cell) -> list[str]:
        """`KEY=VALUE` with which the scenario that is studied has the faults of a cell."""
        found = list(self.settings)
        for name, fault in zip(self.names, cell.faults, strict=False):
            found += [f"faults.{name}.kind={fault.kind}", f"faults.{name}.start_s={cell.time_s!r}"]
            for key in ("wheel", "thruster"):
                if fault.kind.startswith(f"{key}_") and (key == "wheel" or self.file.thrusters):
                    found.append(f"faults.{name}.{key}={getattr(fault, key)}")
        return found


def inject(file: ScenarioFile, count: int) -> Injection:
    """The scenario with `count` faults that cells choose; its first ones give their severities and durations.

    Raises:
        ScenarioError: a dispersion that stays depends on one of a fault.
    """
    own = [each.name for each in file.faults]
    names = (*own, *(name for name in _NAMES if name not in own))[:count]
    settings = [] if file.effects.faults else ["effects.faults=true"]
    for entry in file.dispersions:
        keys = [key.key for key in assigned_keys(entry)]
        chosen = [key for key in keys if key.startswith("faults.") and key.split(".")[-1] in _CHOSEN]
        if chosen and len(chosen) < len(keys):
            others = ", ".join(key for key in keys if key not in chosen)
            expected = f"it alone, since the study chooses it: drawn together with {others}"
            raise ScenarioError("dispersions", chosen[0], expected)
        if chosen:
            settings.append(f"dispersions.{entry.name}=none")
    settings += [f"faults.{name}.kind=none" for name in own[count:]]
    tables = file.model_dump()
    for text in (*settings, *(f"faults.{name}.kind=none" for name in names)):
        apply_override(tables, text)
    return Injection(scenario_loader.validate(tables), names, tuple(settings))


def fault_times(file: ScenarioFile, times_s: Sequence[float] | None, every_s: float | None) -> list[float]:
    """Times at which faults begin [s], by default at the ends of the quarters of a run but the last.

    Raises:
        RpojaxError: a time is not within the run, or both are given.
    """
    if times_s is not None and every_s is not None:
        raise RpojaxError.of_argument("every", f"found {every_s:g} beside times, expected one of the two")
    if times_s is None:
        step = file.duration_s / _PARTS if every_s is None else every_s
        if not 0.0 < step < file.duration_s:
            raise RpojaxError.of_argument("every", f"found {step:g}, expected a time within {file.duration_s:g} s")
        times_s = [step * k for k in range(1, min(math.ceil(file.duration_s / step - 1e-9), _MOST_RUNS))]
    for time in times_s:
        if not 0.0 <= time < file.duration_s:
            raise RpojaxError.of_argument("times", f"found {time:g}, expected a time within {file.duration_s:g} s")
    return sorted(set(times_s))


def check(
    file: ScenarioFile,
    runs: int,
    seed: int,
    times_s: Sequence[float] | None,
    every_s: float | None,
    double: bool,
) -> list[Cell]:
    """Cells of a study, of which what cannot be simulated is refused; arguments are those of `faults`.

    Raises:
        RpojaxError: naming the argument or the key.
    """
    check_study(file, "faults", runs, seed)
    times = fault_times(file, times_s, every_s)
    cells = [Cell(each, time) for each in fault_sets(file, double) for time in times]
    if len(cells) * runs > _MOST_RUNS:
        found = f"found {runs} of each of {len(cells)} faults and times"
        raise RpojaxError.of_argument("runs, times", f"{found}, expected at most {_MOST_RUNS} runs in all")
    return cells


def faults(
    file: ScenarioFile,
    *,
    runs: int = DEFAULT_RUNS,
    seed: int = 0,
    times_s: Sequence[float] | None = None,
    every_s: float | None = None,
    double: bool = False,
    free_drifts: bool = False,
    progress: bool = True,
) -> dict[str, Any]:
    """Which single faults of the equipment, or pairs of them, the runs of a scenario survive, by kind and time.

    Returns the content of faults.json: a cell for each fault and time under `cells`, the same without a fault under
    `nominal`, and under `study` times, requirements and provenance.

    Args:
        file: the scenario
        runs: of each cell, with the scenario's dispersions
        seed: master seed; the runs of all cells have the same numbers
        times_s: when faults begin [s]
        every_s: time between them [s], in place of `times_s`; by default a quarter of the run
        double: inject each two faults of different equipment at once in place of each alone; the first of a pair, in
            the order of the page, has severity and duration of the first fault of the scenario
        free_drifts: judge requirements on free drifts and on coverage, too
        progress: show progress on stderr

    Raises:
        RpojaxError: an option is out of range, or the scenario cannot be studied.
    """
    cells = check(file, runs, seed, times_s, every_s, double)
    injection = inject(file, 2 if double else 1)
    simulated = AssignedRuns(injection.file, injection.keys, runs, seed, free_drifts, _AT_ONCE)
    changes = [{}, *(injection.values(cell, runs) for cell in cells)]
    with run_progress(file.duration_s, quiet=not progress) as show:
        watch = StudyProgress(runs, show, "simulating faults")
        watch.show(compiled=False)
        simulated.compile()
        watch.show(compiled=True)
        nominal, *found = simulated.simulate_changes(changes, watch.round(len(changes)))
    radii = simulated.values.get("limits.keep_out_m", np.full(runs, file.limits.keep_out_m))
    names = requirement_names(file.requirements)
    judged = [each for each in zip(names, file.requirements, strict=True) if each[1].metric_name in nominal]
    study = {
        **provenance(file, runs, seed, free_drifts),
        "times_s": sorted({cell.time_s for cell in cells}),
        "double": double,
        "runs_simulated": watch.done,
        "judged": [name for name, _ in judged],
        "not_judged": [name for name in names if name not in dict(judged)],
    }
    rows = [
        {
            "title": " and ".join(fault.title for fault in cell.faults),
            "kinds": [fault.kind for fault in cell.faults],
            "time_s": cell.time_s,
            **judge_cell(judged, metrics, radii),
            "settings": injection.settings_of(cell),
        }
        for cell, metrics in zip(cells, found, strict=True)
    ]
    return to_json_types({"nominal": judge_cell(judged, nominal, radii), "cells": rows, "study": study})


def judge_cell(
    judged: Sequence[tuple[str, RequirementSection]], found: Mapping[str, np.ndarray], radii: np.ndarray
) -> dict[str, Any]:
    """What the runs of a cell did, from their metrics and `outcomes` (runs,) and their keep-out radii (runs,) [m].

    A run survives if it was not ended before its time and violates no requirement; without one to judge it must not
    fail. Its margin is the least of those of the requirements, over the limit, and negative beyond it.
    """
    outcomes = found["outcomes"]
    survived, runs = ~is_frozen(outcomes), len(outcomes)
    margins = np.full((max(len(judged), 1), runs), np.inf)
    for row, (_, each) in enumerate(judged):
        values, counted = required_values(each, found), counts(each, found, outcomes)
        survived &= ~(violates(each, values) & counted)
        slack = (each.limit - values) if each.bound == "at most" else (values - each.limit)
        # Of a limit of zero there is no share.
        relative = slack / abs(each.limit) if each.limit else np.where(slack < 0.0, -np.inf, np.inf)
        margins[row] = np.where(counted, np.where(np.isfinite(relative), relative, -np.inf), np.inf)
    if not judged:
        survived &= ~is_failed(outcomes)
    # A run that enters the sphere ends there and has no metrics.
    clearance = np.where(outcomes == Outcome.KEEP_OUT, 0.0, found["min_range_m"] - radii)
    least = margins.min(axis=0)
    # Runs that did not survive come first, then the least margin, then the least clearance.
    worst = int(np.lexsort((np.nan_to_num(clearance, nan=-np.inf), least, survived))[0])
    number = int(survived.sum())
    has_clearance = np.isfinite(clearance)
    return {
        "runs": runs,
        "survived": number,
        "survived_share": number / runs,
        "interval_95": clopper_pearson_interval(number, runs),
        "completed": int((~is_failed(outcomes)).sum()),
        "outcomes": {kind: count for kind, count in count_outcomes(outcomes).items() if count},
        "margin": _margin(judged, found, margins),
        "clearance_m": float(clearance[has_clearance].min()) if has_clearance.any() else None,
        "worst_run": worst,
        "worst_outcome": str(outcomes[worst]),
    }


def _margin(
    judged: Sequence[tuple[str, RequirementSection]], found: Mapping[str, np.ndarray], margins: np.ndarray
) -> dict[str, Any] | None:
    """The requirement of the least margin over runs, and its value there; None where none counts for any run."""
    if not judged or np.isposinf(margins).all():
        return None
    row, run = np.unravel_index(np.argmin(margins), margins.shape)
    name, each = judged[int(row)]
    return {
        "requirement": name,
        "value": float(required_values(each, found)[run]),
        "limit": each.limit,
        "unit": UNITS.get(each.metric, "-"),
        "relative": float(margins[row, run]),
    }
