"""Interactive charts of a campaign as plotly dictionaries, thinned so that the page stays small."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rpojax.analysis.statistics.filter_consistency import AverageNees
from rpojax.analysis.statistics.order_statistics import percentiles_over_runs
from rpojax.report.figures.colours import BLUE, FAINT, FONT, GREEN, GRID, INK, MUTED, VERMILLION
from rpojax.report.labels import ChannelLabel, MetricLabel

Chart = dict[str, Any]

_MAX_POINTS = 800
_MAX_BINS = 36
_RUNS_FOR_5_95 = 20
_RUNS_FOR_1_99 = 100
EMPTY_TITLE = {"text": ""}
_OUTER_FILL = "rgba(0, 114, 178, 0.13)"
_INTERVAL_FILL = "rgba(0, 158, 115, 0.25)"
_INNER_FILL = "rgba(0, 114, 178, 0.26)"


def rounded_values(values: np.ndarray) -> list[float | None]:
    """`values` as a list of numbers with five significant digits, None where not finite."""
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in np.asarray(values, dtype=float)]


def worst_run(channel: ChannelLabel, values: np.ndarray, completed: np.ndarray) -> int | None:
    """Completed run with the largest mean of `values` (runs, m) over the last third, or the lowest if low is bad."""
    part = values if channel.low_is_bad else values[:, 2 * values.shape[1] // 3 :]
    candidates = np.flatnonzero(completed & np.isfinite(part).any(axis=1))
    if len(candidates) == 0:
        return None
    if channel.low_is_bad:
        return int(candidates[np.argmin(np.nanmin(part[candidates], axis=1))])
    return int(candidates[np.argmax(np.nanmean(part[candidates], axis=1))])


def envelope_chart(
    channel: ChannelLabel,
    time_s: np.ndarray,
    values: np.ndarray,
    completed: np.ndarray,
    bound: np.ndarray | None = None,
    run_ids: np.ndarray | None = None,
) -> Chart | None:
    """Chart of `values` (runs, m) over time [s]: median, bands, worst run, median of `bound` (runs, m); None if empty.

    At each instant the percentiles are over the runs that have not failed yet. Bands appear when there are runs enough
    to resolve them; below that the outer band is from the smallest to the largest run. `run_ids` (runs,) are the
    numbers of the runs, counted from 0 unless given.
    """
    shown = np.flatnonzero(np.isfinite(values).any(axis=0))
    if len(shown) == 0:
        return None
    shown = shown[:: -(-len(shown) // _MAX_POINTS)]
    time, thinned = rounded_values(time_s[shown]), values[:, shown]
    traces = _percentile_bands(channel, time, thinned)
    median_name = "run" if len(values) == 1 else "median"
    traces.append(_channel_line(channel, time, percentiles_over_runs(thinned, (50.0,))[0], median_name, BLUE, 2.0))
    worst = worst_run(channel, values, completed)
    if worst is not None and len(values) > 1:
        number = worst if run_ids is None else int(run_ids[worst])
        traces.append(_channel_line(channel, time, thinned[worst], f"worst run ({number})", VERMILLION, 1.2))
    if bound is not None:
        middle = percentiles_over_runs(bound[:, shown], (50.0,))[0]
        traces.append(_channel_line(channel, time, middle, "3 sigma of the filter, median", GREEN, 1.8, "dash"))
    return {"data": traces, "layout": _time_layout(channel, traces)}


def histogram_chart(label: MetricLabel, values: np.ndarray) -> Chart:
    """Chart of the distribution of `values` (n,), all finite: median solid, p99 (p1 where low is bad) dashed."""
    counts, edges = histogram_bins(values)
    bars = {
        "type": "bar",
        "x": rounded_values((edges[:-1] + edges[1:]) / 2.0),
        "y": counts.tolist(),
        "width": rounded_values(np.diff(edges)),
        "marker": {"color": BLUE, "opacity": 0.75, "line": {"width": 0}},
        "hovertemplate": "%{y} runs near %{x}<extra></extra>",
    }
    chart_settings = chart_layout(label.unit, "runs")
    chart_settings["bargap"] = 0
    chart_settings["yaxis"]["automargin"] = True
    chart_settings["showlegend"] = False
    chart_settings["shapes"] = [
        _vertical_line(float(np.percentile(values, 50)), "solid"),
        _vertical_line(float(np.percentile(values, 1 if label.low_is_bad else 99)), "dash"),
    ]
    chart_settings["margin"] = {"l": 42, "r": 10, "t": 6, "b": 36}
    return {"data": [bars], "layout": chart_settings}


def histogram_bins(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Counts (k,) and bin edges (k + 1,) of `values` (n,), all finite; each bin of whole numbers is centred on one."""
    low, high = float(values.min()), float(values.max())
    if np.all(values == np.round(values)):
        step = max(1.0, np.ceil((high - low + 1.0) / _MAX_BINS))
        return np.histogram(values, bins=np.arange(low - 0.5, high + 0.5 + step, step))
    bins = int(np.clip(np.ceil(np.sqrt(len(values))), 6, _MAX_BINS))
    margin = 1e-6 * max(abs(low), abs(high))
    wide = high - low > margin
    return np.histogram(values, bins=bins, range=(low, high) if wide else (low - margin, high + margin))


def add_reference_lines(chart: Chart, unit: str, levels: Sequence[tuple[float, str]]) -> Chart:
    """`chart` with horizontal dotted lines at (value, text), values in `unit`, that of the chart."""
    for value, text in levels:
        name = f"{text}: {value:.3g} {unit}"
        ends = [chart["data"][0]["x"][0], chart["data"][0]["x"][-1]]
        line = {"color": INK, "width": 1.4, "dash": "dot"}
        trace = {"type": "scatter", "mode": "lines", "x": ends, "y": [value, value], "name": name, "line": line}
        chart["data"].append({**trace, "hoverinfo": "skip"})
    return chart


def average_nees_chart(channel: ChannelLabel, time_s: np.ndarray, nees: AverageNees, with_interval: bool) -> Chart:
    """Chart of the average over runs of NEES over time [s], with its expectation and, if wanted, its 95 % interval."""
    shown = np.flatnonzero(np.isfinite(nees.mean))
    shown = shown[:: max(1, -(-len(shown) // _MAX_POINTS))]
    time = rounded_values(time_s[shown])
    traces: list[dict[str, Any]] = []
    if with_interval:
        low, high = rounded_values(nees.low[shown]), rounded_values(nees.high[shown])
        traces += band_traces(time, low, high, "95 % of a consistent filter", _INTERVAL_FILL)
    traces.append(_channel_line(channel, time, nees.mean[shown], "average over runs", BLUE, 1.8))
    chart = {"data": traces, "layout": _time_layout(channel, traces)}
    return add_reference_lines(chart, channel.unit, [(float(nees.components), "expected")])


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
    drawn = band_traces(time, _chart_values(channel, low), _chart_values(channel, high), name, fill)
    return [{**edge, "hovertemplate": _hover_template(channel, end)} for edge, end in zip(drawn, ends, strict=True)]


def line_trace(
    x: list[float | None], y: list[float | None], name: str, color: str, width: float, dash: str = "solid"
) -> dict[str, Any]:
    """A line through points, with its name in the legend."""
    style = {"color": color, "width": width, "dash": dash}
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, "name": name, "line": style}


def band_traces(
    x: list[float | None], low: list[float | None], high: list[float | None], name: str, fill: str
) -> list[dict[str, Any]]:
    """An area between two lines, with its name in the legend."""
    edge = {"type": "scatter", "mode": "lines", "x": x, "line": {"width": 0, "color": BLUE}, "legendgroup": name}
    edges = [{**edge, "y": y, "name": name} for y in (low, high)]
    return [{**edges[0], "showlegend": False}, {**edges[1], "fill": "tonexty", "fillcolor": fill}]


def _channel_line(
    channel: ChannelLabel,
    time: list[float | None],
    values: np.ndarray,
    name: str,
    color: str,
    width: float,
    dash: str = "solid",
) -> dict[str, Any]:
    drawn = line_trace(time, _chart_values(channel, values), name, color, width, dash)
    return {**drawn, "hovertemplate": _hover_template(channel, name)}


def _chart_values(channel: ChannelLabel, values: np.ndarray) -> list[float | None]:
    return rounded_values(np.where(values > 0.0, values, np.nan) if channel.logarithmic else values)


def _hover_template(channel: ChannelLabel, name: str) -> str:
    return f"{name}: %{{y:.4g}} {channel.unit}<extra></extra>"


def _time_layout(channel: ChannelLabel, traces: list[dict[str, Any]]) -> dict[str, Any]:
    found = chart_layout("", f"[{channel.unit}]" if channel.unit else "[-]")
    found["xaxis"]["ticksuffix"] = " s"
    found["hovermode"] = "x unified"
    found["legend"] = {"orientation": "h", "x": 0, "y": -0.13, "yanchor": "top", "font": {"size": 11}}
    if channel.logarithmic and _spans_decades(traces):
        minor = {"showgrid": True, "gridcolor": FAINT}
        found["yaxis"].update(type="log", tickformat="~g", dtick=_log_tick_step(traces), minor=minor)
    elif not channel.logarithmic:
        found["yaxis"]["rangemode"] = "tozero"
    return found


def _spans_decades(traces: list[dict[str, Any]]) -> bool:
    """Whether values differ so much that a linear axis would hide the small ones."""
    shown = [value for trace in traces for value in trace["y"] if value is not None]
    return not shown or max(shown) > 5.0 * min(shown)


def _log_tick_step(traces: list[dict[str, Any]]) -> str | int:
    """Plotly's tick step: 1, 2, 5 in each decade where few decades are shown, else one tick a decade."""
    shown = [value for trace in traces for value in trace["y"] if value is not None]
    return "D2" if shown and max(shown) < 3e3 * min(shown) else 1


def chart_layout(x_title: str, y_title: str) -> dict[str, Any]:
    """Plotly's layout of a chart with two titled axes."""
    ticks = {"ticks": "outside", "tickcolor": GRID, "ticklen": 4}
    # Plain decimals: with a prefix, as plotly has it by default, a share of 0.00025 would be "250u".
    axis = {"gridcolor": GRID, "linecolor": MUTED, "zeroline": False, "exponentformat": "none", **ticks}
    return {
        "font": {"family": FONT, "size": 12, "color": INK},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "margin": {"l": 56, "r": 14, "t": 30, "b": 44},
        "xaxis": {**axis, "title": {"text": x_title, "font": {"size": 12}}},
        "yaxis": {**axis, "title": {"text": y_title, "font": {"size": 12}}},
        "showlegend": True,
    }


def _vertical_line(x: float, dash: str) -> dict[str, Any]:
    line = {"color": VERMILLION, "width": 1.6, "dash": dash}
    return {"type": "line", "xref": "x", "yref": "paper", "x0": x, "x1": x, "y0": 0, "y1": 1, "line": line}
