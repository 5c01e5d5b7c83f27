"""Outcome of every run, and the events on the way, from recorded channels and the run's own limits.

It is evaluated after the simulation, so that the loop pays nothing. A flag is raised when a run is lost, diverged, off
station or out of propellant, and cleared when it recovers; the outcome is that of the flags raised at the end. A run
without a flag at the end is unfinished if it missed the goal of its mission, and not judged if it ends before it must
be on station. A run that would otherwise be completed has diverged if its position errors were outside 3 sigma for more
than a tenth of it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rpojax.scenario.dispersed_numbers.values_by_run import values_of_runs
from rpojax.scenario.phases.phase_sections import NO_GOAL
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics import mission_goal
from rpojax.simulation.metrics.recorded_metrics import desired_position_H, outside_sigmas
from rpojax.simulation.outcomes.outcome_events import EventArrays, collect_events
from rpojax.simulation.outcomes.outcome_kinds import FREEZING, RECOVERABLE, Outcome
from rpojax.time_scales import TIME_ROUNDING_S

Flags = NDArray[np.bool_]
Records = Mapping[str, np.ndarray]

DIVERGED_NEES: Final = 6 * 25.0
"""Relative NEES, of 6 components, above which a filter is on the way to be diverged: errors of 5 sigma."""
DIVERGED_AFTER_S: Final = 600.0
"""Time above it without interruption after which the filter is diverged [s]. A choice: three burn periods of
`inspection`, as `limits.lost_after_s`."""
LEAST_COVERAGE: Final = 0.9
"""Fraction of seconds and Hill axes with a relative position error inside 3 sigma, below which no run is completed: of
a consistent filter 0.9973 are, and a run has few independent errors."""
_ROUNDING: Final = 1e-9
"""Of a sum of shares."""

REQUIRED_CHANNELS: Final = (
    "box_accepted",
    "box_outlier",
    "observable",
    "nees_relative",
    "relative_error_H",
    "relative_sigma_H",
    "rho_H",
    "propellant_used_kg",
    "running",
)
"""Channels that the judgement reads."""
LIMIT_KEYS: Final = (
    "limits.lost_after_s",
    "limits.off_station_m",
    "limits.arrive_by_s",
    "limits.propellant_kg",
)
"""Keys of which it takes the values of each run, beside those of the desired position."""


@dataclass(frozen=True)
class JudgedRuns:
    """How runs ended.

    Attributes:
        codes: (runs,) code of the outcome
        since_s: (runs,) time since which a failed run has been in its final state [s], NaN for the others
        events: flags that were raised and cleared
    """

    codes: np.ndarray
    since_s: np.ndarray
    events: EventArrays

    @property
    def failed(self) -> Flags:
        """(runs,) whether the run failed."""
        return np.isin(self.codes, [kind.code for kind in Outcome if kind.is_failure])

    @property
    def frozen(self) -> Flags:
        """(runs,) whether the run ended before its time."""
        return np.isin(self.codes, [kind.code for kind in FREEZING])


def judge(
    file: ScenarioFile,
    varied: Mapping[str, np.ndarray],
    records: Records,
    failure: np.ndarray,
    failed_at_s: np.ndarray,
) -> JudgedRuns:
    """Outcomes and events of runs.

    Args:
        file: the scenario
        varied: values of the runs (runs, ...) by key, of the keys that vary
        records: channels (runs, ticks, ...) at the camera rate
        failure: (runs,) code of the outcome that froze a run, else 0
        failed_at_s: (runs,) when it did [s]
    """
    tick_s = 1.0 / file.rates.camera_hz
    flags = raised_flags(file, varied, records)
    events = collect_events(flags, records["running"], tick_s)
    codes, since_s = failure.astype(np.int8), np.where(failure > 0, failed_at_s, np.nan)
    for kind in RECOVERABLE:
        standing = flags[kind][:, -1] & (codes == Outcome.COMPLETED.code)
        codes[standing] = kind.code
        since_s[standing] = _last_raised_s(flags[kind][standing], tick_s)
    unfinished = (codes == Outcome.COMPLETED.code) & _misses_goal(file, records)
    codes[unfinished] = Outcome.UNFINISHED.code
    if unfinished.any():
        since_s[unfinished] = mission_goal.entered_at_s(file, records)[unfinished]
    codes[(codes == Outcome.COMPLETED.code) & _is_too_short(file, varied, records)] = Outcome.NOT_JUDGED.code
    outside_s = _outside_sigmas_since_s(records, tick_s)
    diverged = (codes == Outcome.COMPLETED.code) & np.isfinite(outside_s)
    codes[diverged], since_s[diverged] = Outcome.DIVERGED.code, outside_s[diverged]
    return JudgedRuns(codes, since_s, events)


def _outside_sigmas_since_s(records: Records, tick_s: float) -> np.ndarray:
    """Time (runs,) at which the seconds and axes outside of 3 sigma became more than a run may have; NaN if never."""
    outside = outside_sigmas(records)
    share = np.cumsum(outside.mean(axis=2), axis=1) / outside.shape[1]
    too_many = share > 1.0 - LEAST_COVERAGE + _ROUNDING
    return np.where(too_many.any(axis=1), tick_s * np.argmax(too_many, axis=1), np.nan)


def _misses_goal(file: ScenarioFile, records: Records) -> Flags:
    """Flags (runs,) of runs that did not come to the goal of their mission."""
    if mission_goal.mission_goal(file) is None:
        return np.zeros(len(records["running"]), dtype=bool)
    return np.isnan(mission_goal.reached_at_s(file, records))


def _is_too_short(file: ScenarioFile, varied: Mapping[str, np.ndarray], records: Records) -> Flags:
    """Flags (runs,) of runs that have no phase to reach, and end before they must be on station: nothing is judged."""
    runs, ticks = records["running"].shape
    goal = mission_goal.mission_goal(file)
    if file.goal.phase == NO_GOAL or (goal is not None and not goal.is_start):
        return np.zeros(runs, dtype=bool)
    end_s = ticks / file.rates.camera_hz
    return np.broadcast_to(end_s < _column(file, varied, "limits.arrive_by_s")[:, 0] - TIME_ROUNDING_S, runs)


def raised_flags(file: ScenarioFile, varied: Mapping[str, np.ndarray], records: Records) -> dict[Outcome, Flags]:
    """Flags (runs, ticks) of the outcomes from which a run may recover."""
    tick_s = 1.0 / file.rates.camera_hz
    limits = {key.rpartition(".")[2]: _column(file, varied, key) for key in LIMIT_KEYS}
    runs, ticks = records["observable"].shape
    time_s = np.arange(ticks) * tick_s
    # The last tick stands for the end of the run.
    time_s[-1] = ticks * tick_s
    desired_H = desired_position_H(file, records, varied).astype(np.float32)
    off = np.linalg.norm(records["rho_H"] - desired_H, axis=2)
    aborted = records["abort_reason"] > 0 if "abort_reason" in records else np.zeros((runs, ticks), dtype=bool)
    true_box = records["box_accepted"] & ~records["box_outlier"]
    consistent = records["nees_relative"] <= DIVERGED_NEES
    flags = {
        # Single precision, as the channel is, so that a run that used exactly the limit counts.
        Outcome.OUT_OF_PROPELLANT: records["propellant_used_kg"] >= limits["propellant_kg"].astype(np.float32),
        Outcome.LOST: tick_s * _count_since(true_box, records["observable"])
        >= limits["lost_after_s"] - TIME_ROUNDING_S,
        Outcome.DIVERGED: tick_s * _count_since(consistent, np.ones_like(consistent))
        >= DIVERGED_AFTER_S - TIME_ROUNDING_S,
        Outcome.ABORTED: aborted,
        Outcome.OFF_STATION: (time_s >= limits["arrive_by_s"] - TIME_ROUNDING_S) & (off > limits["off_station_m"]),
    }
    goal = mission_goal.mission_goal(file)
    if goal is not None and goal.row == len(file.phase_names) - 1:
        # As where an abort is a failure, nothing that it comes before in `RECOVERABLE` counts after it.
        flags |= {kind: flags[kind] & ~aborted for kind in RECOVERABLE[RECOVERABLE.index(Outcome.ABORTED) :]}
    return {kind: np.broadcast_to(flags[kind], (runs, ticks)) for kind in RECOVERABLE}


def _column(file: ScenarioFile, varied: Mapping[str, np.ndarray], key: str) -> np.ndarray:
    """Value of a key in each run: numbers (runs or 1, 1), vectors (runs or 1, 3)."""
    section, _, name = key.partition(".")
    values = values_of_runs(varied, key, getattr(getattr(file, section), name))
    return values[:, None] if values.ndim == 1 else values


def _count_since(events: Flags, counted: Flags) -> np.ndarray:
    """Number of `counted` ticks (runs, ticks) after the last tick with an event, or since the start."""
    total = np.cumsum(counted & ~events, axis=1, dtype=np.int32)
    return total - np.maximum.accumulate(np.where(events, total, 0), axis=1)


def _last_raised_s(flags: Flags, tick_s: float) -> np.ndarray:
    """Time at which flags (runs, ticks), raised at the end, were raised last [s]."""
    ticks = flags.shape[1]
    standing = np.argmin(flags[:, ::-1], axis=1)
    return tick_s * np.where(flags.all(axis=1), 0, ticks - standing)


def judge_one(file: ScenarioFile, varied: Mapping[str, np.ndarray], records: Records) -> Outcome:
    """Outcome of a single run that was not frozen, from channels (1, ticks, ...) and values (1, ...) by key."""
    found = judge(file, varied, records, np.zeros(1, dtype=np.int8), np.full(1, np.nan))
    return list(Outcome)[int(found.codes[0])]
