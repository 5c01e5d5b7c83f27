"""Values for the page's comparison of the worst runs with the median one, and for its 3-D view."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.requirement_limits import limits_of_channels
from rpojax.report.page.single_run.relative_path import path_scene
from rpojax.report.page.single_run.run_series import run_series, series_channels
from rpojax.report.page.single_run.run_timeline import time_marks, timeline
from rpojax.report.page.single_run.shown_runs import WorstRun, worst_runs


@dataclass(frozen=True)
class DetailValues:
    """Data of the charts of single runs, of the 3-D view (None without histories), and template values."""

    detail: dict[str, Any] | None
    scene: dict[str, Any] | None
    template_values: dict[str, Any]


def detail_values(campaign: CampaignResults, content: Mapping[str, Any], median_run: int | None) -> DetailValues:
    """Series and timelines of the median run and of the worst one of each requirement; of a team its first servicer."""
    worst = [] if median_run is None else worst_runs(campaign, content, median_run)
    choices = _choices(worst)
    shown = [] if median_run is None else list(dict.fromkeys([median_run, *(run for run, _ in choices)]))
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
    detail = None if median_run is None else {"runs": series, "channels": channels, "median": median_run}
    values = {
        "worst_shown": worst,
        "worst_choices": choices,
        "detail_channels": channels,
        "timelines": {run: timeline(campaign, run, history, duration) for run, history in histories.items()},
        "marks": time_marks(duration),
        "has_scene": scene is not None,
    }
    return DetailValues(detail, scene, values)


def _choices(worst: list[WorstRun]) -> list[tuple[int, str]]:
    """Number of each worst run, in order, and what it is the worst in."""
    found: dict[int, list[str]] = {}
    for one in worst:
        found.setdefault(one.run_id, []).append(f"{one.title} {one.value}")
    return [(run, "; ".join(words)) for run, words in found.items()]


def _duration(campaign: CampaignResults, histories: Mapping[int, Mapping[str, Any]]) -> float:
    """Duration [s] of the scenario, or of the longest history if it is not recorded."""
    recorded = campaign.info.get("scenario", {}).get("duration_s")
    longest = max((float(history["time_s"][-1]) for history in histories.values()), default=1.0)
    return float(recorded) if recorded else max(longest, 1.0)
