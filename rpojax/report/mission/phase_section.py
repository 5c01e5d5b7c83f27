"""Phases of a mission: runs that reached each, when it began and ended and by what, and figures of the time in it."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from rpojax.flight.mission.mission_state import Transition
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.mission import abort_section, unfinished_section
from rpojax.report.mission.phase_visits import PhaseVisits, phase_visits
from rpojax.report.number_format import format_number

_FIGURES: Final = (
    ("delta_v_m_s", "Delta-v [m/s]", 1.0),
    ("formation_error_rms_m", "Formation error, RMS [m]", 1.0),
    ("nees_relative_mean", "NEES / 6, relative", 1.0 / 6.0),
    ("min_range_m", "Least range [m]", 1.0),
    ("max_range_m", "Greatest range [m]", 1.0),
)
"""Name, heading and factor of each figure of the time in a phase."""
_ENDS: Final = (
    (Transition.CONDITIONS_MET.name.lower(), "conditions met"),
    (Transition.TIMEOUT.name.lower(), "timeout"),
    (Transition.HOLD_COMMAND.name.lower(), "command to hold"),
    (Transition.RESUME_COMMAND.name.lower(), "command to resume"),
    (Transition.ABORT.name.lower(), "abort"),
    ("end_of_run", "end of the run"),
    ("failure", "failure of the run"),
)
"""Ends of a stay in a phase, in JSON and on the page."""


def content(campaign: CampaignResults) -> dict[str, Any] | None:
    """Part of report.json; None without phases.

    A phase begins when a run enters it first and ends when a run leaves it last; runs that end in it have no end of
    it. Its `ends` count stays, of which a run that holds and resumes has several.
    """
    if not campaign.phases:
        return None
    visits = phase_visits(campaign.phases)
    return {
        "phases": [_phase_content(campaign, visits, number) for number in range(len(campaign.phase_names))],
        "runs_with_further_stays": int(np.sum(~visits.complete)),
        "goal": _goal_content(campaign),
        "aborts": abort_section.content(campaign, visits),
    }


def _goal_content(campaign: CampaignResults) -> dict[str, Any] | None:
    """How many runs came to the goal of the mission, and when; None without, and for results of older versions."""
    reached_at, goal = campaign.phases.get("goal_reached_at_s"), unfinished_section.goal(campaign.info["scenario"])
    if reached_at is None or goal is None:
        return None
    counts = {"reached": int(np.isfinite(reached_at).sum()), "runs": len(reached_at)}
    return {"phase": goal[0], "at": goal[1], **counts, "at_s": quantiles(reached_at)}


def goal_text(found: Mapping[str, Any]) -> str:
    """Sentence on how many runs came to the goal, and when; empty without one."""
    goal = found["goal"]
    if goal is None:
        return ""
    when = f", at {quantile_text(goal['at_s'])} s" if goal["reached"] else ""
    return f"Goal: the {goal['at']} of {goal['phase']}, reached in {goal['reached']} of {goal['runs']} runs{when}."


def quantiles(values: np.ndarray) -> dict[str, float | None]:
    """Median, 5th and 95th percentile of the defined ones of `values`; None without any."""
    defined = values[np.isfinite(values)]
    names = ("p5", "p50", "p95")
    if not len(defined):
        return dict.fromkeys(names)
    return dict(zip(names, np.percentile(defined, (5.0, 50.0, 95.0)).tolist(), strict=True))


def _phase_content(campaign: CampaignResults, visits: PhaseVisits, number: int) -> dict[str, Any]:
    there = visits.phase == number
    reached, stays_on = there.any(axis=1), (there & visits.is_last).any(axis=1)
    entered = np.min(np.where(there, visits.begin_s, np.inf), axis=1, initial=np.inf)
    left = np.max(np.where(there & (visits.ended_by >= 0), visits.end_s, -np.inf), axis=1, initial=-np.inf)
    ends = {transition.name.lower(): int(np.sum(there & (visits.ended_by == transition))) for transition in Transition}
    del ends[Transition.START.name.lower()]
    ended = np.asarray(campaign.reached_end, dtype=bool)
    duration = campaign.phases["duration_s"][:, number]
    return {
        "name": campaign.phase_names[number],
        "runs": int(reached.sum()),
        "begin_s": quantiles(np.where(reached, entered, np.nan)),
        "end_s": quantiles(np.where(reached & ~stays_on, left, np.nan)),
        "duration_s": quantiles(np.where(reached, duration, np.nan)),
        **{name: quantiles(campaign.phases[name][:, number]) for name, _, _ in _FIGURES},
        "ends": ends | {"end_of_run": int(np.sum(stays_on & ended)), "failure": int(np.sum(stays_on & ~ended))},
    }


def time_rows(found: Mapping[str, Any]) -> list[list[str]]:
    """Rows of the table of times, phases that no run reached included: name, runs, begin, end, duration, ends."""
    return [
        [
            phase["name"],
            f"{phase['runs']} of {found['aborts']['runs']}",
            *(quantile_text(phase[name]) for name in ("begin_s", "end_s", "duration_s")),
            _ends_text(phase["ends"]),
        ]
        for phase in _shown(found)
    ]


def _ends_text(ends: Mapping[str, int]) -> str:
    counts = ((ends[name], text) for name, text in _ENDS)
    return ", ".join(f"{count} \N{MULTIPLICATION SIGN} {text}" for count, text in counts if count) or format_number(
        None
    )


def figure_headings() -> list[str]:
    """Headings of the table of figures."""
    return [heading for _, heading, _ in _FIGURES]


def figure_rows(found: Mapping[str, Any]) -> list[list[str]]:
    """Rows of the table of figures: name, and each figure of the phases that a run reached."""
    return [
        [phase["name"], *(quantile_text(phase[name], factor) for name, _, factor in _FIGURES)]
        for phase in _shown(found)
        if phase["runs"]
    ]


def _shown(found: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """Phases of the scenario, and the built-in ones that a run reached."""
    phases = found["phases"]
    return [*phases[:-2], *(phase for phase in phases[-2:] if phase["runs"])]


def quantile_text(found: Mapping[str, float | None], factor: float = 1.0) -> str:
    """Median, and the 5th and 95th percentile in brackets where they differ."""
    numbers = (found[name] for name in ("p50", "p5", "p95"))
    median, low, high = (format_number(None if each is None else factor * each, 3) for each in numbers)
    return median if low == high else f"{median} ({low} to {high})"
