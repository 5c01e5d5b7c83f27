"""Evidence of runs in which nothing is wrong, to plant failures in."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from rpojax.analysis.failure_causes.run_evidence import RunEvidence
from rpojax.flight.mission.mission_state import Transition
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics import failure_signs, phase_records

RUNS = 8
FAILED = np.arange(RUNS) < 5
"""The runs that fail."""


def file_of(name: str = "inspection", **tables: Mapping[str, Any]) -> ScenarioFile:
    """A packaged scenario, with values of some tables replaced."""
    content = scenario_loader.load(name).model_dump()
    for table, values in tables.items():
        content[table] = {**content[table], **values}
    if content["effects"]["faults"] and not content["faults"]:
        content["faults"] = [{"name": "fault", "kind": "none"}]
    return ScenarioFile.model_validate(content)


def planted(file: ScenarioFile, outcome: str = "lost", **changes: Any) -> RunEvidence:
    """Evidence of eight runs of which the first five failed; `signs`, `traces` and the like are changed for these.

    A value is a number of ticks in each interval as a share of all, or an array.
    """
    ticks = round(file.duration_s * file.rates.camera_hz)
    every = failure_signs.interval_ticks(ticks, 1.0 / file.rates.camera_hz)
    intervals = -(-ticks // every)
    names = (*failure_signs.COUNTS, failure_signs.FAILED_TESTS)
    signs = {name: np.zeros((RUNS, intervals), np.int32) for name in names}
    for name in ("ticks", "looking", "in_view"):
        signs[name][:] = every
    signs["good_boxes"][:] = round(0.9 * every)
    time_s = np.arange(0.0, file.duration_s, 10.0)
    shape = (RUNS, len(time_s))
    traces = {
        "range_m": np.full(shape, 30.0),
        "formation_error_m": np.full(shape, 0.5),
        "nav_relative_error_m": np.full(shape, 0.2),
        "nees_relative": np.full(shape, 6.0),
        "nav_relative_sigma3_m": np.full(shape, 1.0),
        "wheel_speed_fraction": np.full(shape, 0.3),
        "delta_v_m_s": np.broadcast_to(1e-6 * time_s, shape).copy(),
    }
    metrics = {"sigma3_coverage": np.full(RUNS, 1.0), "nees_relative_mean": np.full(RUNS, 6.0)}
    for name, value in changes.pop("signs", {}).items():
        signs[name][FAILED] = value if isinstance(value, int) else round(value * every)
    for name, value in changes.pop("traces", {}).items():
        traces[name][FAILED] = value
    for name, value in changes.pop("metrics", {}).items():
        metrics[name][FAILED] = value
    return RunEvidence(
        file=file,
        outcomes=np.where(FAILED, outcome, "completed"),
        failed_at_s=np.where(FAILED, 3000.0, np.nan),
        metrics=metrics,
        time_s=time_s,
        traces=traces,
        signs=changes.pop("signs_of_run", signs),
        **changes,
    )


def phases_of(file: ScenarioFile, last: int, unmet: int = 0, abort_reason: int = 0) -> dict[str, np.ndarray]:
    """Arrays of phases: all begin one after the other each 1000 s, but failed runs stay in `last`, or abort from it."""
    shape = (RUNS, phase_records.MAX_TRANSITIONS)
    phase, by, at_s = np.full(shape, -1, np.int8), np.full(shape, -1, np.int8), np.full(shape, np.nan)
    names = len(file.phase_names)
    for run in range(RUNS):
        end = last + 1 if FAILED[run] else len(file.phases)
        phase[run, :end], by[run, :end] = np.arange(end), Transition.CONDITIONS_MET
        at_s[run, :end] = 1000.0 * np.arange(end)
        if FAILED[run] and abort_reason:
            phase[run, end], by[run, end], at_s[run, end] = names - 1, Transition.ABORT, 1000.0 * end
    return {
        "transition_phase": phase,
        "transition_by": by,
        "transition_at_s": at_s,
        "transition_count": (phase >= 0).sum(axis=1),
        "corridor_ahead_m": np.where(FAILED, 24.0, np.nan),
        "corridor_aside_m": np.where(FAILED, 6.0, np.nan),
        "duration_s": np.full((RUNS, names), 1000.0),
        "abort_reason": np.where(FAILED, abort_reason, 0).astype(np.int8),
        "unmet_conditions": np.where(FAILED, unmet, 0).astype(np.int8),
    }
