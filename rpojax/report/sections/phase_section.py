"""Phases of a mission: runs that reached each, when and why it ended, figures of the time in it, and aborts."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from rpojax.flight.mission.mission_state import AbortReason, Transition
from rpojax.metrics.passive_safety import FINAL_DRIFT_RANGE
from rpojax.report.campaign_results import CampaignResults, keep_out_radii, probability_interval
from rpojax.report.labels import format_number, format_percent_interval
from rpojax.report.sections.phase_visits import PhaseVisits, goal_of, phase_visits
from rpojax.simulation.outcomes.outcome_kinds import Outcome

_RANGES: Final = ("least_range_m", "final_range_m", FINAL_DRIFT_RANGE)
"""Ranges of an aborted run: least range after the abort, range at the end, and least range from the last burn to 24 h
of free drift after the end."""
_LISTED: Final = 5
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


def abort_content(campaign: CampaignResults, visits: PhaseVisits) -> dict[str, Any]:
    """Part of report.json: aborts by reason and phase, the least of their ranges, and every run that has aborted."""
    runs = _aborted_runs(campaign, visits)
    count, total = len(runs), len(campaign.run_ids)
    groups: dict[tuple[int, str], list[dict[str, Any]]] = {}
    for run in runs:
        groups.setdefault((run["code"], run["phase"]), []).append(run)
    return {
        "count": count,
        "runs": total,
        "interval_95": probability_interval(campaign, count, total),
        "below_keep_out": {name: sum(run["below_keep_out"][name] for run in runs) for name in _RANGES},
        "least": {name: _least(runs, name) for name in _RANGES},
        "by_reason": [_group(each) for _, each in sorted(groups.items(), key=lambda item: -len(item[1]))],
        "listed": [
            {name: value for name, value in run.items() if name not in ("code", "below_keep_out")} for run in runs
        ],
    }


def abort_sentences(found: Mapping[str, Any]) -> list[tuple[str, bool]]:
    """Sentences on the result of the aborts, and whether each is an alert."""
    count = found["count"]
    if not count:
        return [(f"None of {found['runs']} runs aborted.", False)]
    share = f"{count} of {found['runs']} runs aborted"
    if found["interval_95"] is not None:
        share += f" (95 % interval of the probability: {format_percent_interval(*found['interval_95'])})"
    lines = [(f"{share}.", False)]
    for name, text in (
        ("least_range_m", "from the abort to the end of the run"),
        ("final_range_m", "at the end of the run"),
        (FINAL_DRIFT_RANGE, "from the last burn to 24 h of free drift after the end of the run"),
    ):
        least, below = found["least"][name], found["below_keep_out"][name]
        if least is None:
            continue
        known = f"All {count}" if least["runs"] == count else f"The {least['runs']} for which it is known"
        line = (
            f"{known} stayed at {format_number(least['value'], 3)} m or more {text} (nearest: run {least['run_id']})."
        )
        lines.append((f"{line} {below} inside the keep-out sphere." if below else line, below > 0))
    return lines


def abort_rows(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Rows of the table by reason and phase, most frequent first."""
    return [
        {
            "reason": group["reason"],
            "phase": group["phase"],
            "count": group["count"],
            "at_s": _interval_text(group["at_s"]),
            "ranges": [format_number(group["least"][name], 3) for name in _RANGES],
            "runs": ", ".join(map(str, group["nearest_runs"])),
            "first": group["nearest_runs"][0],
        }
        for group in found["by_reason"]
    ]


def _group(runs: list[dict[str, Any]]) -> dict[str, Any]:
    times = [run["at_s"] for run in runs]
    least = {name: _least(runs, name) for name in _RANGES}
    return {
        "reason": runs[0]["reason"],
        "phase": runs[0]["phase"],
        "count": len(runs),
        "at_s": [min(times), max(times)],
        "least": {name: None if one is None else one["value"] for name, one in least.items()},
        "nearest_runs": [run["run_id"] for run in sorted(runs, key=lambda run: run["least_range_m"])[:_LISTED]],
    }


def _least(runs: list[dict[str, Any]], name: str) -> dict[str, Any] | None:
    """Least value of a range, the run that has it, and the number of runs that have a value; None if no run has one."""
    known = [run for run in runs if math.isfinite(run[name])]
    if not known:
        return None
    least = min(known, key=lambda run: run[name])
    return {"value": least[name], "run_id": least["run_id"], "runs": len(known)}


def _interval_text(ends: list[float]) -> str:
    low, high = map(format_number, ends)
    return low if low == high else f"{low} to {high}"


def _aborted_runs(campaign: CampaignResults, visits: PhaseVisits) -> list[dict[str, Any]]:
    reasons = campaign.phases["abort_reason"]
    before, aborted = visits.phase_before_abort(), len(campaign.phase_names) - 1
    began = np.min(np.where(visits.phase == aborted, visits.begin_s, np.inf), axis=1, initial=np.inf)
    undefined = np.full(len(reasons), np.nan)
    ranges = {
        "least_range_m": campaign.phases["min_range_m"][:, aborted],
        **{name: campaign.metrics.get(name, undefined) for name in _RANGES[1:]},
    }
    radii = keep_out_radii(campaign)
    keep_out = np.broadcast_to(-np.inf if radii is None else radii, len(reasons))
    # A run that enters the sphere is frozen before: its last recorded range is still outside.
    entered = np.asarray(campaign.outcomes == Outcome.KEEP_OUT)
    ranges["least_range_m"] = np.where(entered, np.minimum(ranges["least_range_m"], keep_out), ranges["least_range_m"])
    return [
        {
            "run_id": int(campaign.run_ids[row]),
            "code": int(reasons[row]),
            "reason": AbortReason(int(reasons[row])).text,
            "phase": campaign.phase_names[before[row]] if before[row] >= 0 else campaign.phase_names[0],
            "at_s": float(began[row]),
            **{name: float(values[row]) for name, values in ranges.items()},
            "below_keep_out": {
                name: bool(values[row] < keep_out[row] or (entered[row] and name == _RANGES[0]))
                for name, values in ranges.items()
            },
        }
        for row in np.flatnonzero(reasons > 0)
    ]


def content(campaign: CampaignResults) -> dict[str, Any] | None:
    """Part of report.json; None without phases.

    A phase begins when a run enters it first and ends when a run leaves it last; runs that end in it have no end of
    it. Its `ends` count stays: a run that holds and resumes has several.
    """
    if not campaign.phases:
        return None
    visits = phase_visits(campaign.phases)
    return {
        "phases": [_phase_content(campaign, visits, number) for number in range(len(campaign.phase_names))],
        "runs_with_further_stays": int(np.sum(~visits.complete)),
        "goal": _goal_content(campaign),
        "aborts": abort_content(campaign, visits),
    }


def _goal_content(campaign: CampaignResults) -> dict[str, Any] | None:
    """How many runs came to the mission's goal, and when; None without a goal and for results of older versions."""
    reached_at, goal = campaign.phases.get("goal_reached_at_s"), goal_of(campaign.info["scenario"])
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
    """Median, 5th and 95th percentile of the defined ones of `values`; None if all are undefined."""
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
    median, low, high = (format_number(None if number is None else factor * number, 3) for number in numbers)
    return median if low == high else f"{median} ({low} to {high})"
