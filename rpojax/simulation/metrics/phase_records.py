"""What is stored of the phases of every run: when each began and by what, and time, delta-v, errors and ranges in each.

Names of arrays are those of the group `phases` of a campaign.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rpojax.flight.mission.mission_state import AbortReason, Transition
from rpojax.metrics.metric_definition import Floats
from rpojax.scenario.dispersed_numbers.values_by_run import values_of_runs
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics import mission_goal

MAX_TRANSITIONS: Final = 32
"""Most beginnings of phases that are stored of a run: the first ones. A choice: their count is stored, too."""
PLACE_IN_TARGET_FRAME: Final = "rho_estimate_T"
"""Channel of the estimated place, in scenarios with phases in the frame of the target."""
UNITS: Final = {
    "duration_s": "s",
    "delta_v_m_s": "m/s",
    "formation_error_rms_m": "m",
    "nees_relative_mean": "-",
    "min_range_m": "m",
    "max_range_m": "m",
    "abort_reason": "-",
    "goal_reached_at_s": "s",
    "unmet_conditions": "-",
    "corridor_ahead_m": "m",
    "corridor_aside_m": "m",
    "arrival_place_P_m": "m",
    "transition_count": "-",
    "transition_phase": "-",
    "transition_by": "-",
    "transition_at_s": "s",
}
"""Unit of every array by name."""


@dataclass(frozen=True)
class PhaseTransition:
    """A phase that began in a run.

    Attributes:
        run_id: number of the run
        at_s: since its start [s]
        phase: name of the phase
        by: what began it
        abort_reason: why, if it is an abort
    """

    run_id: int
    at_s: float
    phase: str
    by: Transition
    abort_reason: AbortReason


def evaluate(
    file: ScenarioFile, records: Mapping[str, np.ndarray], varied: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Arrays of runs from channels (runs, ticks, ...), up to where a run was frozen; empty without phases.

    Those of a phase are (runs, phases), NaN for phases that a run never was in: total time [s], velocity change, RMS
    formation error (none after an abort), mean relative NEES, least and greatest range. Those of transitions are
    (runs, 32): number of the phase that begins, what began it and when, the start of the run included. Of the goal:
    when it was reached [s], NaN if never, and the conditions that did not hold at the end of the last phase of the
    scenario that the run was in, as bits of `Condition`. Of a corridor that was left: where the estimate was in the
    tick of the abort, along the axis and beside it (runs,) [m], NaN for other runs. Of missions that end at a docking
    port: the true place from it as the last phase begins, in P (runs, 3) [m], NaN for runs that never come there.
    `varied` holds the values (runs, ...) of the keys that vary from run to run.
    """
    if not file.phases:
        return {}
    phase, running = records["phase"], records["running"]
    tick_s = 1.0 / file.rates.camera_hz
    aborted = len(file.phase_names) - 1
    squared_error = np.square(records["rho_H"] - records["rho_desired_H"], dtype=float).sum(axis=2)
    gained = np.diff(records["delta_v_m_s"].astype(float), axis=1, append=records["delta_v_m_s"][:, -1:])
    columns: dict[str, list[Floats]] = {}
    for number in range(len(file.phase_names)):
        within = running & (phase == number)
        ticks = within.sum(axis=1)
        there = ticks > 0
        values = {
            "delta_v_m_s": _sum(gained, within),
            "formation_error_rms_m": np.sqrt(_sum(squared_error, within) / np.maximum(ticks, 1)),
            "nees_relative_mean": _sum(records["nees_relative"], within) / np.maximum(ticks, 1),
            "min_range_m": np.min(records["range_m"], axis=1, where=within, initial=np.inf).astype(float),
            "max_range_m": np.max(records["range_m"], axis=1, where=within, initial=-np.inf).astype(float),
        }
        if number == aborted:
            values["formation_error_rms_m"] = np.full(len(phase), np.nan)
        columns.setdefault("duration_s", []).append(ticks * tick_s)
        for name, value in values.items():
            columns.setdefault(name, []).append(np.where(there, value, np.nan))
    stored = {name: np.stack(values, axis=1) for name, values in columns.items()}
    last = np.maximum(running.sum(axis=1) - 1, 0)
    reason = records["abort_reason"][np.arange(len(phase)), last].astype(np.int8)
    of_goal = {
        "goal_reached_at_s": mission_goal.reached_at_s(file, records),
        "unmet_conditions": _unmet_conditions(phase < len(file.phases), records),
    }
    transitions = _transitions(phase, records["phase_entered_by"], running, tick_s)
    of_corridor = _corridor_left(file, records, varied)
    of_port = {"arrival_place_P_m": _arrival_place(file, records)} if file.ends_at_port else {}
    return stored | {"abort_reason": reason} | of_goal | of_corridor | of_port | transitions


def _arrival_place(file: ScenarioFile, records: Mapping[str, np.ndarray]) -> Floats:
    """True place (runs, 3) of the servicer from the port in P [m] as the last phase begins first, NaN if never."""
    there = (records["phase"] == len(file.phases) - 1) & records["running"]
    place = records["port_place_P"][np.arange(len(there)), np.argmax(there, axis=1)].astype(float)
    return np.where(there.any(axis=1)[:, None], place, np.nan)


def _corridor_left(
    file: ScenarioFile, records: Mapping[str, np.ndarray], varied: Mapping[str, np.ndarray]
) -> dict[str, Floats]:
    """Estimated position (runs,) along and beside the axis of a corridor as it is left [m], NaN where none is."""
    runs = np.arange(len(records["phase"]))
    left = (records["abort_reason"] == AbortReason.CORRIDOR_LEFT) & records["running"]
    tick = np.argmax(left, axis=1)
    before = records["phase"][runs, np.maximum(tick - 1, 0)]
    # The error is that of the target from the servicer.
    estimates = {"hill": (records["rho_H"][runs, tick] - records["relative_error_H"][runs, tick]).astype(float)}
    if PLACE_IN_TARGET_FRAME in records:
        estimates["target"] = records[PLACE_IN_TARGET_FRAME][runs, tick].astype(float)
    ahead, aside = np.full((2, len(runs)), np.nan)
    for number, phase in enumerate(file.phases):
        here = left.any(axis=1) & (before == number)
        if phase.corridor is not None and here.any():
            axes = values_of_runs(varied, f"phases.{phase.name}.corridor.axis", np.asarray(phase.corridor.axis))
            place = estimates[phase.frame]
            unit = np.broadcast_to(axes / np.linalg.norm(axes, axis=-1, keepdims=True), place.shape)
            along = np.sum(unit * place, axis=1)
            ahead[here] = along[here]
            aside[here] = np.linalg.norm(place - along[:, None] * unit, axis=1)[here]
    return {"corridor_ahead_m": ahead, "corridor_aside_m": aside}


def _unmet_conditions(in_table: np.ndarray, records: Mapping[str, np.ndarray]) -> np.ndarray:
    """Conditions (runs,) that do not hold at the last tick in a phase of the scenario."""
    chosen = in_table & records["running"]
    last = chosen.shape[1] - 1 - np.argmax(chosen[:, ::-1], axis=1)
    return records["unmet_conditions"][np.arange(len(chosen)), last].astype(np.int8)


def _sum(values: np.ndarray, within: np.ndarray) -> Floats:
    return np.sum(values, axis=1, where=within, dtype=float)


def _transitions(
    phase: np.ndarray, entered_by: np.ndarray, running: np.ndarray, tick_s: float
) -> dict[str, np.ndarray]:
    begins = running.copy()
    begins[:, 1:] &= phase[:, 1:] != phase[:, :-1]
    shape = (len(phase), MAX_TRANSITIONS)
    found = {
        "transition_phase": np.full(shape, -1, np.int8),
        "transition_by": np.full(shape, -1, np.int8),
        "transition_at_s": np.full(shape, np.nan),
    }
    for run, own in enumerate(begins):
        ticks = np.flatnonzero(own)[:MAX_TRANSITIONS]
        found["transition_phase"][run, : len(ticks)] = phase[run, ticks]
        found["transition_by"][run, : len(ticks)] = entered_by[run, ticks]
        found["transition_at_s"][run, : len(ticks)] = ticks * tick_s
    return {"transition_count": begins.sum(axis=1).astype(np.int32), **found}


def listed_transitions(
    run_ids: np.ndarray, names: Sequence[str], stored: Mapping[str, np.ndarray]
) -> list[PhaseTransition]:
    """Transitions of runs as a list, by run and time, from their stored arrays; empty without these."""
    if not stored:
        return []
    listed = []
    for row, place in np.argwhere(stored["transition_phase"] >= 0).tolist():
        by = Transition(int(stored["transition_by"][row, place]))
        reason = AbortReason(int(stored["abort_reason"][row])) if by is Transition.ABORT else AbortReason.NONE
        name = names[int(stored["transition_phase"][row, place])]
        listed.append(
            PhaseTransition(int(run_ids[row]), float(stored["transition_at_s"][row, place]), name, by, reason)
        )
    return listed
