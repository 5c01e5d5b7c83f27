"""Stays of runs in the phases of a mission, from the recorded transitions."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rpojax.flight.mission.mission_state import Condition, Transition
from rpojax.flight.mission.static_mission_settings import BUILT_IN_PHASES
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.colours import BLUE, GREEN, ORANGE, PURPLE, SHADE, SKY_BLUE, VERMILLION, YELLOW
from rpojax.report.figures.plotly_charts import MAX_POINTS, Chart, rounded_values, time_layout
from rpojax.report.labels import ChannelLabel
from rpojax.scenario.phases.phase_sections import CONDITION_KEYS, NO_GOAL
from rpojax.simulation.outcomes.outcome_kinds import Outcome

Numbers = NDArray[np.integer]
Times = NDArray[np.floating]
_SHARE: Final = ChannelLabel("phase_share", "Runs in each phase", "%")
_COLOURS: Final = (BLUE, ORANGE, GREEN, PURPLE, SKY_BLUE, YELLOW)
_HOLD: Final = BUILT_IN_PHASES[0]


@dataclass(frozen=True)
class PhaseVisits:
    """Stays of each run in order of time; (runs, stays), as many as the run with the most has.

    Attributes:
        phase: number of the phase, -1 for none
        begin_s: [s], NaN for none
        end_s: beginning of the next one [s], NaN for the last
        ended_by: the `Transition` that ended it, -1 for the last
        complete: (runs,) whether all stays of the run were recorded
    """

    phase: Numbers
    begin_s: Times
    end_s: Times
    ended_by: Numbers
    complete: NDArray[np.bool_]

    @property
    def is_last(self) -> NDArray[np.bool_]:
        """(runs, stays) whether it lasted as long as the run did."""
        return (self.phase >= 0) & (self.ended_by < 0) & self.complete[:, None]

    def phase_before_abort(self) -> Numbers:
        """(runs,) number of the phase that an abort ended, -1 without one."""
        rows, places = np.nonzero(self.ended_by == Transition.ABORT)
        found = np.full(len(self.phase), -1)
        found[rows] = self.phase[rows, places]
        return found

    def at(self, time_s: Times, frozen_at_s: Times) -> Numbers:
        """(runs, samples) number of the phase at each time [s], -1 after a run was frozen, if at all (runs,)."""
        found = np.full((len(self.phase), len(time_s)), -1)
        for place in range(self.phase.shape[1]):
            began = self.begin_s[:, place : place + 1] <= time_s
            found = np.where(began, self.phase[:, place : place + 1], found)
        return np.where(time_s > np.where(np.isnan(frozen_at_s), np.inf, frozen_at_s)[:, None], -1, found)


def phase_visits(stored: Mapping[str, np.ndarray]) -> PhaseVisits:
    """Stays from the arrays of `rpojax.simulation.metrics.phase_records.evaluate`."""
    kept = stored["transition_phase"].shape[1]
    shown = slice(int(np.clip(np.max(stored["transition_count"], initial=1), 1, kept)))
    phase, begin_s, by = (stored[f"transition_{name}"][:, shown] for name in ("phase", "at_s", "by"))
    none = np.full((len(phase), 1), -1)
    return PhaseVisits(
        phase=phase.astype(int),
        begin_s=begin_s,
        end_s=np.concatenate([begin_s[:, 1:], np.full(none.shape, np.nan)], axis=1),
        ended_by=np.concatenate([by[:, 1:].astype(int), none], axis=1),
        complete=stored["transition_count"] <= kept,
    )


def share_chart(campaign: CampaignResults) -> Chart | None:
    """Shares of all runs [%], stacked in the order of the phases; None without phases.

    Runs that were frozen by then are in none.
    """
    if not campaign.phases:
        return None
    duration = float(campaign.info["scenario"]["duration_s"])
    step = max(1.0, np.ceil(duration / MAX_POINTS))
    time_s = np.append(np.arange(0.0, duration, step), duration)
    frozen_at_s = np.where(campaign.reached_end, np.nan, campaign.failed_at_s)
    present = phase_visits(campaign.phases).at(time_s, frozen_at_s)
    traces = []
    for number, name in enumerate(campaign.phase_names):
        share = 100.0 * np.mean(present == number, axis=0)
        if share.any():
            traces.append(_area(name, _colour(number, len(campaign.phase_names)), time_s, share))
    layout = time_layout(_SHARE, traces)
    layout["yaxis"]["range"] = [0, 100]
    layout["legend"]["traceorder"] = "normal"
    return {"data": traces, "layout": layout}


def _colour(number: int, count: int) -> str:
    """Colour of a phase; the last two are those of holding and of aborts."""
    built_in = {count - 2: SHADE, count - 1: VERMILLION}
    return built_in.get(number, _COLOURS[number % len(_COLOURS)])


def _area(name: str, colour: str, time_s: np.ndarray, share: np.ndarray) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "stackgroup": "phases",
        "x": rounded_values(time_s),
        "y": rounded_values(share),
        "name": name,
        "line": {"width": 0, "color": colour, "shape": "hv"},
        "fillcolor": colour,
        "hovertemplate": f"{name}: %{{y:.3g}} %<extra></extra>",
    }


def unfinished_details(campaign: CampaignResults) -> dict[int, str]:
    """Where each unfinished run of one servicer stayed and why, by its number."""
    unfinished = np.flatnonzero(np.asarray(campaign.outcomes) == Outcome.UNFINISHED)
    if not len(unfinished) or not campaign.phases:
        return {}
    visits, names = phase_visits(campaign.phases), list(campaign.phase_names)
    unmet, wanted = campaign.phases["unmet_conditions"], goal_of(campaign.info.get("scenario", {}))
    goal_row = -1 if wanted is None else names.index(wanted[0])
    return {
        int(campaign.run_ids[row]): _detail(visits, names, row, Condition(int(unmet[row])), goal_row)
        for row in unfinished.tolist()
    }


def goal_of(scenario: Mapping[str, Any]) -> tuple[str, str] | None:
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
    conditions = ", ".join(key for condition, key in CONDITION_KEYS.items() if condition & unmet)
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
