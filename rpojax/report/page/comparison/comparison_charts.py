"""Overlays of campaigns: histograms of metrics, and medians with bands of channels over time."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from rpojax.analysis.statistics.intervals import percentiles_over_runs
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.charts.histogram_chart import histogram_bins
from rpojax.report.figures.charts.plotly_charts import Chart, band_traces, chart_layout, limit_line, rounded_values
from rpojax.report.figures.charts.time_chart import channel_line, chart_values, time_layout
from rpojax.report.figures.colours import BLUE, GREEN, ORANGE, PURPLE, SHADE, VERMILLION
from rpojax.report.figures.requirement_limits import Limit
from rpojax.report.labels import CHANNEL_LABELS, ChannelLabel, MetricLabel, metric_label

COLOURS: Final = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SHADE)
_FILLS: Final = (
    "rgba(0, 114, 178, 0.15)",
    "rgba(213, 94, 0, 0.15)",
    "rgba(0, 158, 115, 0.15)",
    "rgba(204, 121, 167, 0.15)",
    "rgba(230, 159, 0, 0.15)",
    "rgba(138, 151, 168, 0.15)",
)
_MAX_POINTS: Final = 300


def histogram_overlay(
    name: str, campaigns: Sequence[CampaignResults], names: Sequence[str], limits: Sequence[Limit]
) -> Chart | None:
    """Share of the runs [%] by value of a metric, one stepped line for each campaign; None without variation."""
    label: MetricLabel = metric_label(name)
    columns = [np.asarray(campaign.metrics.get(name, ()), dtype=np.float64) for campaign in campaigns]
    finite = [values[np.isfinite(values)] for values in columns]
    together = np.concatenate(finite)
    if len(together) < 2 or float(np.ptp(together)) == 0.0:
        return None
    _, edges = histogram_bins(together)
    traces: list[dict[str, Any]] = []
    for number, values in enumerate(finite):
        if not len(values):
            continue
        share = 100.0 * np.histogram(values, bins=edges)[0] / len(columns[number])
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": rounded_values(np.repeat(edges, 2)),
                "y": rounded_values(np.concatenate([[0.0], np.repeat(share, 2), [0.0]])),
                "name": names[number],
                "line": {"color": COLOURS[number], "width": 1.8, "dash": "solid"},
                "hovertemplate": f"{names[number]}: %{{y:.3g}} % of its runs",
            }
        )
    layout = chart_layout(label.unit, "share of runs [%]")
    layout["shapes"] = [limit_line(limit.value, limit.text, upright=True) for limit in limits]
    return {"data": traces, "layout": layout}


def envelope_overlays(
    campaigns: Sequence[CampaignResults], names: Sequence[str]
) -> dict[str, tuple[ChannelLabel, Chart]]:
    """Channel and chart by name of every channel that all campaigns have: medians, and bands from 5 to 95 %."""
    found: dict[str, tuple[ChannelLabel, Chart]] = {}
    for channel in CHANNEL_LABELS:
        if all(channel.name in campaign.traces for campaign in campaigns):
            traces = [
                trace
                for number, campaign in enumerate(campaigns)
                for trace in _envelope(channel, campaign, names[number], number)
            ]
            if traces:
                found[channel.name] = (channel, {"data": traces, "layout": time_layout(channel, traces)})
    return found


def _envelope(channel: ChannelLabel, campaign: CampaignResults, name: str, number: int) -> list[dict[str, Any]]:
    values = np.asarray(campaign.traces[channel.name], dtype=np.float64)
    shown = np.flatnonzero(np.isfinite(values).any(axis=0)) if values.size else np.zeros(0, dtype=int)
    if not len(shown):
        return []
    shown = shown[:: -(-len(shown) // _MAX_POINTS)]
    time = rounded_values(campaign.trace_time_s[shown])
    low, middle, high = percentiles_over_runs(values[:, shown], (5.0, 50.0, 95.0))
    band = band_traces(
        time, chart_values(channel, low), chart_values(channel, high), f"{name}, 5\N{EN DASH}95 %", _FILLS[number]
    )
    return [*band, channel_line(channel, time, middle, f"{name}, median", COLOURS[number], 1.8)]
