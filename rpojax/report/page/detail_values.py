"""Values for the page's comparison of the worst runs with the median one, and for its 3-D view."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.errors import ResultError
from rpojax.metrics.metric_catalogue import worst_first
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.requirement_limits import limits_of_channels
from rpojax.report.labels import format_number, metric_label, with_unit
from rpojax.report.page.run_series import path_scene, run_series, series_channels
from rpojax.report.page.run_timeline import time_marks, timeline

_FAR_PATH = 2.5
"""Times the middle of the farthest distances beyond which a path does not set the scale of the view."""
_SELECTION_METRIC = "formation_error_rms_m"


@dataclass(frozen=True)
class WorstRun:
    """Worst run in a metric among those with a history: the metric, its value, and the value of the median run.

    `worst_id` is the worst run of all. If that has no history, `remark` says so, and a better run is shown instead.
    """

    run_id: int
    worst_id: int
    metric: str
    title: str
    value: str
    median_value: str
    remark: str = ""


def worst_runs(campaign: CampaignResults, content: Mapping[str, Any], median_run: int | None) -> list[WorstRun]:
    """Worst run of every requirement, the weakest first; without requirements of the metrics that the report ranks."""
    ranked: list[tuple[str, bool | None]] = [
        (str(entry.get("of", entry["metric"])), entry["bound"] == "at least")
        for entry in _weakest_first(content["requirements"])
    ]
    ranked = ranked or [(str(entry["metric"]), None) for entry in content["worst_runs"]]
    found = [_worst_run(campaign, name, low_is_bad, median_run) for name, low_is_bad in dict.fromkeys(ranked)]
    return [one for one in found if one is not None]


def _weakest_first(requirements: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Requirements by their share of violations, then by the worst value relative to the limit."""

    def badness(entry: Mapping[str, Any]) -> tuple[float, float]:
        if entry["worst"] is None:
            return -float(entry["violations"]), 0.0
        sign = 1.0 if entry["bound"] == "at most" else -1.0
        return -float(entry["violations"]), sign * (entry["limit"] - entry["worst"]) / (abs(entry["limit"]) or 1.0)

    return sorted(requirements, key=badness)


def _worst_run(
    campaign: CampaignResults, name: str, low_is_bad: bool | None, median_run: int | None
) -> WorstRun | None:
    values = campaign.metrics.get(name)
    if values is None:
        return None
    ranked = [int(campaign.run_ids[row]) for row in worst_first(name, values, low_is_bad)]
    kept = set(campaign.history_ids)
    shown = next((run for run in ranked if run in kept), None)
    if shown is None or len(ranked) < 2:
        return None
    remark = "" if shown == ranked[0] else f"run {ranked[0]} is worse; its history was not kept"
    label = metric_label(name)

    def text(run: int | None) -> str:
        rows = np.flatnonzero(campaign.run_ids == run)
        value = float(values[rows[0]]) if run is not None and len(rows) else None
        return with_unit(format_number(value), label.unit)

    return WorstRun(shown, ranked[0], name, label.title, text(shown), text(median_run), remark)


@dataclass(frozen=True)
class DetailValues:
    """Data of the charts of single runs, of the 3-D view (None without histories), and template values."""

    detail: dict[str, Any] | None
    scene: dict[str, Any] | None
    template_values: dict[str, Any]


def detail_values(
    campaign: CampaignResults, content: Mapping[str, Any], median_run: int | None, others: int = 0
) -> DetailValues:
    """Series and timelines of the median run, of the worst one of each requirement, and of some others.

    Of a team they are those of its first servicer; there are at most `others` further runs.
    """
    worst = [] if median_run is None else worst_runs(campaign, content, median_run)
    choices = _choices(worst)
    shown = [] if median_run is None else list(dict.fromkeys([median_run, *(run for run, _ in choices)]))
    further = [] if median_run is None else _further_runs(campaign, content, shown)[:others]
    shown += [run for run, _ in further]
    # Of a team the path needs all servicers, the charts the first one.
    histories = {run: campaign.history(run, 0) for run in shown}
    series = {run: run_series(history) for run, history in histories.items()}
    limits = limits_of_channels(content["requirements"])
    channels = [
        {
            **channel,
            "limits": [{"value": limit.value, "text": limit.channel_text} for limit in limits.get(channel["name"], [])],
        }
        for channel in series_channels()
        if any(channel["name"] in one for one in series.values())
    ]
    duration = _duration(campaign, histories)
    scene = path_scene(campaign, median_run, [run for run, _ in choices], campaign.history)
    if scene is not None:
        scene |= _view_reach(scene["paths"])
    detail = None if median_run is None else {"runs": series, "channels": channels, "median": median_run}
    values = {
        "worst_shown": worst,
        "worst_choices": choices,
        "other_choices": further,
        "kept_runs": sorted(campaign.history_ids),
        "detail_channels": channels,
        "timelines": {run: timeline(campaign, run, history, duration) for run, history in histories.items()},
        "marks": time_marks(duration),
        "has_scene": scene is not None,
    }
    return DetailValues(detail, scene, values)


def _further_runs(campaign: CampaignResults, content: Mapping[str, Any], shown: Sequence[int]) -> list[tuple[int, str]]:
    """Other runs with a history, failed ones first, and how they ended."""
    failed = {failure["run_id"]: str(failure["reason"]) for failure in content["failures"]}
    kept = [run for run in sorted(campaign.history_ids) if run not in shown]
    return [(run, failed.get(run, "not failed")) for run in sorted(kept, key=lambda run: (run not in failed, run))]


def _view_reach(paths: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Distance [m] that the 3-D view shows where a few paths lead far away, and a note on them; nothing otherwise."""
    farthest = np.array([_farthest(path["points"]) for path in paths])
    middle = float(np.median(farthest))
    beyond = farthest > _FAR_PATH * middle
    if not beyond.any():
        return {}
    reach = float(farthest[~beyond].max())
    count = int(beyond.sum())
    note = f"{count} {'path leads' if count == 1 else 'paths lead'} out of the view, to {float(farthest.max()):.3g} m"
    return {"reach_m": reach, "beyond": note}


def _farthest(points: Sequence[float]) -> float:
    """Largest distance from the target of a path's coordinates in a row."""
    return float(np.linalg.norm(np.reshape(points, (-1, 3)), axis=1).max(initial=0.0))


def _choices(worst: list[WorstRun]) -> list[tuple[int, str]]:
    """Number of each worst run, in order, and the metrics in which it is the worst."""
    found: dict[int, list[str]] = {}
    for one in worst:
        found.setdefault(one.run_id, []).append(f"{one.title} {one.value}")
    return [(run, "; ".join(words)) for run, words in found.items()]


def _duration(campaign: CampaignResults, histories: Mapping[int, Mapping[str, Any]]) -> float:
    """Duration [s] of the scenario, or of the longest history if it is not recorded."""
    recorded = campaign.info.get("scenario", {}).get("duration_s")
    longest = max((float(history["time_s"][-1]) for history in histories.values()), default=1.0)
    return float(recorded) if recorded else max(longest, 1.0)


def choose_run(campaign: CampaignResults, run_id: int | None = None) -> int | None:
    """Run to show in detail: `run_id`, else the run with a history whose formation error is the median, if any.

    Raises:
        ResultError: no history of `run_id` is stored.
    """
    kept = sorted(campaign.history_ids)
    if run_id is not None:
        if run_id not in kept:
            listed = ", ".join(map(str, kept[:20])) or "none"
            raise ResultError(f"run {run_id}: found no history, expected one of: {listed}")
        return run_id
    values = campaign.metrics.get(_SELECTION_METRIC, np.full(len(campaign.completed), np.nan))
    errors = dict(zip(campaign.run_ids.tolist(), values.tolist(), strict=True))
    ranked = sorted((run for run in kept if np.isfinite(errors.get(run, np.nan))), key=lambda run: errors[run])
    if ranked:
        return ranked[(len(ranked) - 1) // 2]
    return kept[0] if kept else None
