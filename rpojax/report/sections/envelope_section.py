"""Envelopes over time: one chart for each recorded channel."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rpojax.analysis.statistics.consistency import mean_nees_interval
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.dispersed_inputs import keep_out_radii
from rpojax.report.figures.charts.envelope_chart import envelope_chart
from rpojax.report.figures.charts.plotly_charts import Chart, add_reference_lines, limit_line
from rpojax.report.figures.requirement_limits import Limit, limits_of_channels
from rpojax.report.labels import CHANNEL_LABELS, FURTHER_CHANNEL_LABELS, ChannelLabel

_NEES_COMPONENTS = 12


def envelope_charts(
    campaign: CampaignResults, requirements: Sequence[Mapping[str, Any]] = ()
) -> dict[str, tuple[ChannelLabel, Chart]]:
    """Channel and envelope chart by channel name, for every channel with a finite value, with the limits on it.

    `requirements` are the entries of report.json. Channels beyond the usual ones are drawn if one limits them.
    """
    limits = limits_of_channels(requirements)
    charts: dict[str, tuple[ChannelLabel, Chart]] = {}
    for channel in (*CHANNEL_LABELS, *(one for one in FURTHER_CHANNEL_LABELS if one.name in limits)):
        values = campaign.traces.get(channel.name)
        if values is None:
            continue
        bound = campaign.traces.get("nav_relative_sigma3_m") if channel.name == "nav_relative_error_m" else None
        ended = np.asarray(campaign.reached_end, dtype=bool)
        chart = envelope_chart(channel, campaign.trace_time_s, values, ended, bound, campaign.run_ids)
        if chart is not None:
            charts[channel.name] = (channel, _with_limits(chart, limits.get(channel.name, [])))
    for name, levels in _reference_levels(campaign).items():
        if name in charts:
            channel, chart = charts[name]
            add_reference_lines(chart, channel.unit, levels)
    return charts


def _with_limits(chart: Chart, limits: Sequence[Limit]) -> Chart:
    """The chart with a line at each limit, which its vertical axis includes."""
    shapes = [limit_line(limit.value, limit.channel_text) for limit in limits]
    return {**chart, "layout": {**chart["layout"], "shapes": [*chart["layout"].get("shapes", []), *shapes]}}


def _reference_levels(campaign: CampaignResults) -> dict[str, list[tuple[float, str]]]:
    """Horizontal lines (value, text) by channel name: chi-square limits of NEES, radii of the keep-out spheres."""
    low, high = mean_nees_interval(_NEES_COMPONENTS, 1, 0.9)
    levels = {"nees": [(low, "consistent filter, 5 %"), (12.0, "mean"), (high, "95 %")]}
    radii = keep_out_radii(campaign)
    if radii is not None:
        smallest, largest = float(radii.min()), float(radii.max())
        levels["range_m"] = [(smallest, "keep-out sphere")]
        if smallest < largest:
            levels["range_m"] = [(smallest, "smallest keep-out sphere"), (largest, "largest keep-out sphere")]
    return levels
