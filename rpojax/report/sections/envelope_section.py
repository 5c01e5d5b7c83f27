"""Envelopes over time: one chart for each recorded channel."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rpojax.analysis.statistics.filter_consistency_intervals import mean_square_interval
from rpojax.analysis.statistics.intervals import percentiles_over_runs
from rpojax.report.campaign_results import CampaignResults, keep_out_radii
from rpojax.report.figures.colours import BLUE, GREEN, VERMILLION
from rpojax.report.figures.plotly_charts import (
    MAX_POINTS,
    Chart,
    add_reference_lines,
    band_traces,
    channel_line,
    chart_values,
    hover_template,
    limit_line,
    rounded_values,
    time_layout,
)
from rpojax.report.figures.requirement_limits import Limit, limits_of_channels
from rpojax.report.labels import CHANNEL_LABELS, FURTHER_CHANNEL_LABELS, ChannelLabel

_RUNS_FOR_5_95 = 20
_RUNS_FOR_1_99 = 100
_OUTER_FILL = "rgba(0, 114, 178, 0.13)"
_INNER_FILL = "rgba(0, 114, 178, 0.26)"
_NEES_COMPONENTS = 12


def worst_run(channel: ChannelLabel, values: np.ndarray, ended: np.ndarray) -> int | None:
    """Row of the run with the largest mean of `values` (runs, m) over the last third, of those that `ended` (runs,).

    If low values are bad, the run with the smallest value. None if no such run has a value.
    """
    part = values if channel.low_is_bad else values[:, 2 * values.shape[1] // 3 :]
    candidates = np.flatnonzero(ended & np.isfinite(part).any(axis=1))
    if len(candidates) == 0:
        return None
    if channel.low_is_bad:
        return int(candidates[np.argmin(np.nanmin(part[candidates], axis=1))])
    return int(candidates[np.argmax(np.nanmean(part[candidates], axis=1))])


def envelope_chart(
    channel: ChannelLabel,
    time_s: np.ndarray,
    values: np.ndarray,
    ended: np.ndarray,
    bound: np.ndarray | None = None,
    run_ids: np.ndarray | None = None,
    limits: Sequence[float] = (),
) -> Chart | None:
    """Chart of `values` (runs, m) over time [s]: median, bands, worst run, median of `bound` (runs, m); None if empty.

    At each instant the percentiles are over the runs that have not been frozen yet. A band is drawn if there are enough
    runs to resolve it; with fewer, the outer band extends from the smallest to the largest run. `run_ids` (runs,) are
    by default 0, 1, 2, ...; the axis includes the `limits`.
    """
    shown = np.flatnonzero(np.isfinite(values).any(axis=0))
    if len(shown) == 0:
        return None
    shown = shown[:: -(-len(shown) // MAX_POINTS)]
    time, thinned = rounded_values(time_s[shown]), values[:, shown]
    traces = _percentile_bands(channel, time, thinned)
    median_name = "run" if len(values) == 1 else "median"
    traces.append(channel_line(channel, time, percentiles_over_runs(thinned, (50.0,))[0], median_name, BLUE, 2.0))
    worst = worst_run(channel, values, ended)
    if worst is not None and len(values) > 1:
        number = worst if run_ids is None else int(run_ids[worst])
        traces.append(channel_line(channel, time, thinned[worst], f"worst run ({number})", VERMILLION, 1.2))
    if bound is not None:
        middle = percentiles_over_runs(bound[:, shown], (50.0,))[0]
        traces.append(channel_line(channel, time, middle, "3 sigma of the filter, median", GREEN, 1.8, "dash"))
    return {"data": traces, "layout": time_layout(channel, traces, thinned, limits)}


def _percentile_bands(channel: ChannelLabel, time: list[float | None], values: np.ndarray) -> list[dict[str, Any]]:
    runs = len(values)
    if runs < 2:
        return []
    outer = (1.0, 99.0) if runs >= _RUNS_FOR_1_99 else (0.0, 100.0)
    traces = _percentile_band(channel, time, values, outer, _OUTER_FILL)
    if runs >= _RUNS_FOR_5_95:
        traces += _percentile_band(channel, time, values, (5.0, 95.0), _INNER_FILL)
    return traces


def _percentile_band(
    channel: ChannelLabel, time: list[float | None], values: np.ndarray, percents: tuple[float, float], fill: str
) -> list[dict[str, Any]]:
    low, high = percentiles_over_runs(values, percents)
    whole = percents == (0.0, 100.0)
    name = "smallest to largest" if whole else f"{percents[0]:.0f}\N{EN DASH}{percents[1]:.0f} %"
    ends = ("smallest", "largest") if whole else tuple(f"{percent:.0f} %" for percent in percents)
    drawn = band_traces(time, chart_values(channel, low), chart_values(channel, high), name, fill)
    return [{**edge, "hovertemplate": hover_template(channel, end)} for edge, end in zip(drawn, ends, strict=True)]


def envelope_charts(
    campaign: CampaignResults, requirements: Sequence[Mapping[str, Any]] = ()
) -> dict[str, tuple[ChannelLabel, Chart]]:
    """Channel and envelope chart by channel name, for every channel with a finite value, with the limits on it.

    `requirements` are the entries of report.json. Channels beyond the usual ones are drawn if one limits them.
    """
    limits = limits_of_channels(requirements)
    references = _reference_levels(campaign)
    charts: dict[str, tuple[ChannelLabel, Chart]] = {}
    for channel in (*CHANNEL_LABELS, *(label for label in FURTHER_CHANNEL_LABELS if label.name in limits)):
        values = campaign.traces.get(channel.name)
        if values is None:
            continue
        bound = campaign.traces.get("nav_relative_sigma3_m") if channel.name == "nav_relative_error_m" else None
        ended = np.asarray(campaign.reached_end, dtype=bool)
        levels = [
            *(limit.value for limit in limits.get(channel.name, [])),
            *(level for level, _ in references.get(channel.name, [])),
        ]
        chart = envelope_chart(channel, campaign.trace_time_s, values, ended, bound, campaign.run_ids, levels)
        if chart is not None:
            charts[channel.name] = (channel, _with_limits(chart, limits.get(channel.name, [])))
    for name, levels in references.items():
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
    low, high = mean_square_interval(_NEES_COMPONENTS, 1, 0.9)
    levels = {"nees": [(low, "consistent filter, 5 %"), (12.0, "mean"), (high, "95 %")]}
    radii = keep_out_radii(campaign)
    if radii is not None:
        smallest, largest = float(radii.min()), float(radii.max())
        levels["range_m"] = [(smallest, "keep-out sphere")]
        if smallest < largest:
            levels["range_m"] = [(smallest, "smallest keep-out sphere"), (largest, "largest keep-out sphere")]
    return levels
