"""Goal of a mission of phases: which phase must begin or end, and when each run came to it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rpojax.flight.mission.mission_state import Transition
from rpojax.metrics.metric_definition import Floats
from rpojax.scenario.phases.phase_sections import NO_GOAL
from rpojax.scenario.schema import ScenarioFile


@dataclass(frozen=True)
class MissionGoal:
    """What a run must have reached by its end.

    Attributes:
        phase: its name
        row: its number in the order of the channel `phase`
        at: its begin, or the time at which its conditions are met
    """

    phase: str
    row: int
    at: Literal["begin", "end"]

    @property
    def is_start(self) -> bool:
        """Whether every run has reached it at its start, as in a mission of one phase without conditions."""
        return self.row == 0 and self.at == "begin"


def mission_goal(file: ScenarioFile) -> MissionGoal | None:
    """Goal of a scenario: by default the end of the last phase where that has `until`, else its begin.

    None without phases, and where the scenario says that there is none.
    """
    if not file.phases or file.goal.phase == NO_GOAL:
        return None
    name = file.goal.phase or file.phases[-1].name
    ends = any(phase.name == name and phase.until is not None for phase in file.phases)
    return MissionGoal(name, file.phase_names.index(name), file.goal.at or ("end" if ends else "begin"))


def reached_at_s(file: ScenarioFile, records: Mapping[str, np.ndarray]) -> Floats:
    """Time (runs,) at which runs came to the goal [s], NaN for those that did not, and without a goal.

    Args:
        file: the scenario
        records: `phase`, `phase_entered_by`, `unmet_conditions` and `running` (runs, ticks)
    """
    goal = mission_goal(file)
    if goal is None:
        return np.full(len(records["running"]), np.nan)
    reached = records["phase"] == goal.row
    if goal.at == "end":
        reached = _meets_conditions(goal.row, is_last=goal.row == len(file.phases) - 1, records=records)
    reached = reached & records["running"]
    return np.where(reached.any(axis=1), reached.argmax(axis=1) / file.rates.camera_hz, np.nan)


def _meets_conditions(row: int, is_last: bool, records: Mapping[str, np.ndarray]) -> np.ndarray:
    """Flags (runs, ticks): the conditions of a phase are met, and the next one begins unless it is the last."""
    phase = records["phase"]
    if is_last:
        return (phase == row) & (records["unmet_conditions"] == 0)
    found = np.zeros(phase.shape, dtype=bool)
    by_conditions = records["phase_entered_by"][:, 1:] == Transition.CONDITIONS_MET
    found[:, 1:] = (phase[:, :-1] == row) & (phase[:, 1:] == row + 1) & by_conditions
    return found


def entered_at_s(file: ScenarioFile, records: Mapping[str, np.ndarray]) -> Floats:
    """Time (runs,) since which runs have been in the phase in which they ended [s]."""
    phase = records["phase"]
    changes = phase[:, 1:] != phase[:, :-1]
    after_last = changes.shape[1] - np.argmax(changes[:, ::-1], axis=1)
    return np.where(changes.any(axis=1), after_last, 0) / file.rates.camera_hz
