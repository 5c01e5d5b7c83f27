"""Range and error over time of the median and of the worst run, from traces, which every campaign stores."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from rpojax.metrics.metric_catalogue import worst_first
from rpojax.report.campaign_results import CampaignResults, nominal_keep_out_radii
from rpojax.report.figures.colours import BLUE, INK, VERMILLION
from rpojax.report.figures.plotly_charts import (
    MAX_POINTS,
    Chart,
    channel_line,
    limit_line,
    rounded_values,
    time_layout,
)
from rpojax.report.figures.requirement_limits import CHANNEL_OF_METRIC, limits_of_channels
from rpojax.report.labels import CHANNEL_LABELS, ChannelLabel, format_number, heading

_RANGE, _ERROR = "range_m", "formation_error_m"
_RANKING: Final = "formation_error_rms_m"
"""Metric of the median run, and of the worst one where none failed and no requirement is violated."""


@dataclass(frozen=True)
class TraceChart:
    """A chart of two runs over time by the name that the page gives it, with its title."""

    name: str
    title: str
    chart: Chart


class ShownRun(NamedTuple):
    """Row of the run beside the median one, and what it is, with its number."""

    row: int
    name: str


def charts(campaign: CampaignResults, content: Mapping[str, Any]) -> list[TraceChart]:
    """Charts of the range and of the error that violates a requirement most, else of the formation error.

    They show the median run and the worst one, the limits, and when the worst one failed; none without traces. A run
    that is shown since it failed is called so: nothing says that it is the worst of those that did.
    """
    requirements = sorted(content["requirements"], key=lambda entry: -float(entry["violations"]))
    violated = [entry for entry in requirements if entry["violations"]]
    channels = [CHANNEL_OF_METRIC.get(str(entry["metric"]), "") for entry in violated]
    labels = {label.name: label for label in CHANNEL_LABELS}
    error = next((name for name in channels if name in labels and name != _RANGE), _ERROR)
    ranked = worst_first(_RANKING, campaign.metrics[_RANKING]) if _RANKING in campaign.metrics else np.zeros(0, int)
    shown, median = _shown_run(campaign, violated, ranked), int(ranked[len(ranked) // 2]) if len(ranked) else None
    found = []
    for name in (_RANGE, error):
        values = campaign.traces.get(name)
        if values is None or shown is None or not np.isfinite(values).any():
            continue
        chart = _chart(campaign, labels[name], np.asarray(values), shown, median, content)
        found.append(TraceChart(f"trace-{name}", f"{heading(labels[name]).partition(' and its')[0]} over time", chart))
    return found


def _shown_run(campaign: CampaignResults, violated: Sequence[Mapping[str, Any]], ranked: np.ndarray) -> ShownRun | None:
    """Run beside the median: a failed one of the most violated requirement, another failed one, else the worst."""
    failed = np.asarray(campaign.failed, dtype=bool)
    ids = campaign.run_ids.tolist()
    rows = {run: row for row, run in enumerate(ids)}
    named = [rows[run] for entry in violated for run in entry["violating_ids"] if run in rows]
    if by_failure := [*(row for row in named if failed[row]), *np.flatnonzero(failed).tolist()]:
        row, count = by_failure[0], int(failed.sum())
        name = f"failed run {ids[row]}" if count == 1 else f"run {ids[row]}, one of {count} that failed"
        return ShownRun(row, name)
    if worst := [*named, *ranked.tolist()]:
        return ShownRun(worst[0], f"worst run {ids[worst[0]]}")
    return ShownRun(0, f"run {ids[0]}") if rows else None


def _chart(
    campaign: CampaignResults,
    channel: ChannelLabel,
    values: np.ndarray,
    shown: ShownRun,
    median: int | None,
    content: Mapping[str, Any],
) -> Chart:
    row = shown.row
    columns = np.arange(values.shape[1])[:: -(-values.shape[1] // MAX_POINTS)]
    time, ids = rounded_values(np.asarray(campaign.trace_time_s)[columns]), campaign.run_ids
    traces = []
    if median is not None and median != row:
        traces.append(channel_line(channel, time, values[median, columns], f"median run {ids[median]}", BLUE, 2.0))
    traces.append(channel_line(channel, time, values[row, columns], shown.name, VERMILLION, 1.6))
    limits = limits_of_channels(content["requirements"]).get(channel.name, [])
    shapes = [limit_line(limit.value, limit.channel_text) for limit in limits]
    if channel.name == _RANGE:
        shapes += [limit_line(radius, f"keep-out {radius:g} m") for radius in nominal_keep_out_radii(campaign)]
    failed_s, outcome = float(campaign.failed_at_s[row]), str(campaign.failure_reason[row])
    if np.isfinite(failed_s):
        text = f"run {ids[row]}: {outcome}, {format_number(failed_s)} s"
        line = {"color": INK, "width": 1.4, "dash": "dot"}
        shapes.append({**limit_line(failed_s, text, upright=True), "line": line, "name": "failure"})
    layout = time_layout(channel, traces, values[[row], :], [limit.value for limit in limits])
    return {"data": traces, "layout": {**layout, "shapes": shapes}}
