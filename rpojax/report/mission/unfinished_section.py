"""Unfinished runs: in which phase each stayed, and which of the phase's conditions did not hold."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from rpojax.flight.mission.mission_state import Condition, Transition
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.mission.phase_visits import PhaseVisits, phase_visits
from rpojax.scenario.phases.phase_sections import BUILT_IN_PHASES, NO_GOAL
from rpojax.simulation.outcomes.outcome_kinds import Outcome

_KEYS: Final = {
    Condition.TIME: "time_s",
    Condition.ARRIVAL: "arrival_box_m",
    Condition.RANGE_SIGMA: "range_sigma_m",
    Condition.GROUND_GO: "ground_go_s",
}
"""Key of `until` of each condition."""
_HOLD: Final = BUILT_IN_PHASES[0]


def details(campaign: CampaignResults) -> dict[int, str]:
    """Where each unfinished run of one servicer stayed and why, by its number."""
    unfinished = np.flatnonzero(np.asarray(campaign.outcomes) == Outcome.UNFINISHED)
    if not len(unfinished) or not campaign.phases:
        return {}
    visits, names = phase_visits(campaign.phases), list(campaign.phase_names)
    unmet, wanted = campaign.phases["unmet_conditions"], goal(campaign.info.get("scenario", {}))
    goal_row = -1 if wanted is None else names.index(wanted[0])
    return {
        int(campaign.run_ids[row]): _detail(visits, names, row, Condition(int(unmet[row])), goal_row)
        for row in unfinished.tolist()
    }


def goal(scenario: Mapping[str, Any]) -> tuple[str, str] | None:
    """Phase of the goal of a scenario's tables and which end of it, None where there is none."""
    given, phases = scenario.get("goal") or {}, scenario.get("phases") or []
    if not phases or given.get("phase") == NO_GOAL:
        return None
    name = given.get("phase") or str(phases[-1]["name"])
    ends = any(phase["name"] == name and phase.get("until") for phase in phases)
    return name, given.get("at") or ("end" if ends else "begin")


def _detail(visits: PhaseVisits, names: list[str], row: int, unmet: Condition, goal_row: int) -> str:
    """Where a run stayed, and why."""
    if not visits.complete[row]:
        return "changed its phase more often than is recorded"
    phases = visits.phase[row][visits.phase[row] >= 0].tolist()
    conditions = ", ".join(key for condition, key in _KEYS.items() if condition & unmet)
    why = f": {conditions} not met" if conditions else ""
    if len(phases) > 1 and names[phases[-1]] == _HOLD:
        before, by = names[phases[-2]], visits.ended_by[row, len(phases) - 2]
        if by == Transition.TIMEOUT:
            return f"held after the timeout of {before}{why}"
        return f"held by command in {before}"
    if goal_row in phases[:-1]:
        by = Transition(int(visits.ended_by[row, phases.index(goal_row)]))
        return f"left {names[goal_row]} by {by.text}"
    return f"stayed in {names[phases[-1]]}{why}"
