"""Aborts of a mission: how many, why and in which phase, how near they came, and where they end."""

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from rpojax.analysis.statistics.intervals import clopper_pearson_interval
from rpojax.flight.mission.mission_state import AbortReason
from rpojax.metrics.passive_safety import FINAL_DRIFT_RANGE
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.dispersed_inputs import keep_out_radii
from rpojax.report.mission.phase_visits import PhaseVisits
from rpojax.report.number_format import format_number, format_percent_interval
from rpojax.report.run_independence import runs_are_independent
from rpojax.simulation.outcomes.outcome_kinds import Outcome

_RANGES: Final = ("least_range_m", "final_range_m", FINAL_DRIFT_RANGE)
"""Of a run that has aborted: least range from then on, range at the end, least one in 24 h of drift after the end."""
_LISTED: Final = 5


def content(campaign: CampaignResults, visits: PhaseVisits) -> dict[str, Any]:
    """Part of report.json: aborts by reason and phase, the least of their ranges, and every run that has aborted."""
    runs = _aborted_runs(campaign, visits)
    count, total = len(runs), len(campaign.run_ids)
    interval = clopper_pearson_interval(count, total) if total and runs_are_independent(campaign) else None
    groups: dict[tuple[int, str], list[dict[str, Any]]] = {}
    for run in runs:
        groups.setdefault((run["code"], run["phase"]), []).append(run)
    return {
        "count": count,
        "runs": total,
        "interval_95": None if interval is None else list(interval),
        "below_keep_out": {name: sum(run["below_keep_out"][name] for run in runs) for name in _RANGES},
        "least": {name: _least(runs, name) for name in _RANGES},
        "by_reason": [_group(each) for _, each in sorted(groups.items(), key=lambda item: -len(item[1]))],
        "listed": [
            {name: value for name, value in run.items() if name not in ("code", "below_keep_out")} for run in runs
        ],
    }


def sentences(found: Mapping[str, Any]) -> list[tuple[str, bool]]:
    """What the aborts came to, each with whether it is an alert."""
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


def rows(found: Mapping[str, Any]) -> list[dict[str, Any]]:
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
    """Least value of a range, the run that has it, and the number of runs that have a value; None without any."""
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
