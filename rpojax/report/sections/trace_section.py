"""Range and error over time of the median and of the worst run, from traces, which every campaign stores."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

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
"""Metric of the median run, and of the worst one where no requirement is violated."""


@dataclass(frozen=True)
class TraceChart:
    """A chart of two runs over time by the name that the page gives it, with its title."""

    name: str
    title: str
    chart: Chart


def charts(campaign: CampaignResults, content: Mapping[str, Any]) -> list[TraceChart]:
    """Charts of the range and of the error that violates a requirement most, else of the formation error.

    They show the median run and the worst one, the limits, and when the worst one failed; none without traces.
    """
    requirements = sorted(content["requirements"], key=lambda entry: -float(entry["violations"]))
    violated = [entry for entry in requirements if entry["violations"]]
    channels = [CHANNEL_OF_METRIC.get(str(entry["metric"]), "") for entry in violated]
    labels = {label.name: label for label in CHANNEL_LABELS}
    error = next((name for name in channels if name in labels and name != _RANGE), _ERROR)
    ranked = worst_first(_RANKING, campaign.metrics[_RANKING]) if _RANKING in campaign.metrics else np.zeros(0, int)
    worst, median = _worst_row(campaign, violated, ranked), int(ranked[len(ranked) // 2]) if len(ranked) else None
    found = []
    for name in (_RANGE, error):
        values = campaign.traces.get(name)
        if values is None or worst is None or not np.isfinite(values).any():
            continue
        chart = _chart(campaign, labels[name], np.asarray(values), worst, median, content)
        found.append(TraceChart(f"trace-{name}", f"{heading(labels[name]).partition(' and its')[0]} over time", chart))
    return found


def _worst_row(campaign: CampaignResults, violated: Sequence[Mapping[str, Any]], ranked: np.ndarray) -> int | None:
    """Row of the worst run: a failed one of the most violated requirement, else the first of the `ranked` rows."""
    failed = np.asarray(campaign.failed, dtype=bool)
    rows = {int(run): row for row, run in enumerate(campaign.run_ids)}
    named = [rows[run] for entry in violated for run in entry["violating_ids"] if run in rows]
    by_rank = [*(row for row in named if failed[row]), *np.flatnonzero(failed), *named, *ranked, *rows.values()]
    return int(by_rank[0]) if by_rank else None


def _chart(
    campaign: CampaignResults,
    channel: ChannelLabel,
    values: np.ndarray,
    worst: int,
    median: int | None,
    content: Mapping[str, Any],
) -> Chart:
    columns = np.arange(values.shape[1])[:: -(-values.shape[1] // MAX_POINTS)]
    time, ids = rounded_values(np.asarray(campaign.trace_time_s)[columns]), campaign.run_ids
    traces = []
    if median is not None and median != worst:
        traces.append(channel_line(channel, time, values[median, columns], f"median run {ids[median]}", BLUE, 2.0))
    traces.append(channel_line(channel, time, values[worst, columns], f"worst run {ids[worst]}", VERMILLION, 1.6))
    limits = limits_of_channels(content["requirements"]).get(channel.name, [])
    shapes = [limit_line(limit.value, limit.channel_text) for limit in limits]
    if channel.name == _RANGE:
        shapes += [limit_line(radius, f"keep-out {radius:g} m") for radius in nominal_keep_out_radii(campaign)]
    failed_s, outcome = float(campaign.failed_at_s[worst]), str(campaign.failure_reason[worst])
    if np.isfinite(failed_s):
        text = f"run {ids[worst]}: {outcome}, {format_number(failed_s)} s"
        line = {"color": INK, "width": 1.4, "dash": "dot"}
        shapes.append({**limit_line(failed_s, text, upright=True), "line": line, "name": "failure"})
    layout = time_layout(channel, traces, values[[worst], :], [limit.value for limit in limits])
    return {"data": traces, "layout": {**layout, "shapes": shapes}}
