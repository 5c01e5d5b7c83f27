"""Building blocks of charts: lines, bands, limits, layout. Charts are dictionaries in plotly's format.

The page draws them itself (`page/assets/charts.js`), the part of the format that is used here: `scatter` traces with
lines, points, bands and stacked areas, `bar` traces, straight shapes with labels; linear, logarithmic and categorical
axes.
"""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from rpojax.report.figures.axis_scale import axis_ends, spans_decades
from rpojax.report.figures.colours import BLUE, FAINT, FONT, GRID, INK, MUTED, VERMILLION
from rpojax.report.figures.requirement_limits import Limit
from rpojax.report.labels import ChannelLabel, MetricLabel, format_number

Chart = dict[str, Any]
"""Plotly figure: `data` (traces) and `layout`."""
EMPTY_TITLE = {"text": ""}
MAX_POINTS = 800
"""Most points of a line, so that the page stays small."""
_MAX_BINS = 36
_FARTHEST_SPANS: Final = 3.0
"""Spans of the values beyond which a limit is marked at the edge of the chart, so that the values stay visible."""


def rounded_values(values: np.ndarray) -> list[float | None]:
    """`values` as a list of numbers with five significant digits, None where not finite."""
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in np.asarray(values, dtype=float)]


def add_reference_lines(chart: Chart, unit: str, levels: Sequence[tuple[float, str]]) -> Chart:
    """`chart` with a horizontal dotted line at each (value, text), in the chart's `unit`."""
    for value, text in levels:
        name = f"{text}: {value:.3g} {unit}"
        ends = [chart["data"][0]["x"][0], chart["data"][0]["x"][-1]]
        line = {"color": INK, "width": 1.4, "dash": "dot"}
        trace = {"type": "scatter", "mode": "lines", "x": ends, "y": [value, value], "name": name, "line": line}
        chart["data"].append({**trace, "hoverinfo": "skip"})
    return chart


def limit_line(value: float, text: str, upright: bool = False) -> dict[str, Any]:
    """Line of a limit with its text, across the chart or `upright`; by its name the axes include it."""
    line = {"color": VERMILLION, "width": 1.6, "dash": "dash"}
    shape: dict[str, Any] = {"type": "line", "name": "limit", "line": line, "label": {"text": text}}
    if upright:
        return {**shape, "xref": "x", "yref": "paper", "x0": value, "x1": value, "y0": 0, "y1": 1}
    return {**shape, "xref": "paper", "yref": "y", "x0": 0, "x1": 1, "y0": value, "y1": value}


def line_trace(
    x: list[float | None], y: list[float | None], name: str, color: str, width: float, dash: str = "solid"
) -> dict[str, Any]:
    """Line trace with its name in the legend."""
    style = {"color": color, "width": width, "dash": dash}
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, "name": name, "line": style}


def band_traces(
    x: list[float | None], low: list[float | None], high: list[float | None], name: str, fill: str
) -> list[dict[str, Any]]:
    """Shaded area between two lines, with its name in the legend."""
    edge = {"type": "scatter", "mode": "lines", "x": x, "line": {"width": 0, "color": BLUE}, "legendgroup": name}
    edges = [{**edge, "y": y, "name": name} for y in (low, high)]
    return [{**edges[0], "showlegend": False}, {**edges[1], "fill": "tonexty", "fillcolor": fill}]


def chart_layout(x_title: str, y_title: str) -> dict[str, Any]:
    """Plotly layout with two titled axes."""
    ticks = {"ticks": "outside", "tickcolor": GRID, "ticklen": 4}
    # Plain decimals: by default plotly shows a fraction of 0.00025 as "250u".
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


def channel_line(
    channel: ChannelLabel,
    time: list[float | None],
    values: np.ndarray,
    name: str,
    color: str,
    width: float,
    dash: str = "solid",
) -> dict[str, Any]:
    """Line of a channel's `values` over time, with unit and name in the hover text."""
    trace = line_trace(time, chart_values(channel, values), name, color, width, dash)
    return {**trace, "hovertemplate": hover_template(channel, name)}


def chart_values(channel: ChannelLabel, values: np.ndarray) -> list[float | None]:
    """Values to draw; without those at or below zero on a logarithmic axis."""
    return rounded_values(np.where(values > 0.0, values, np.nan) if channel.logarithmic else values)


def hover_template(channel: ChannelLabel, name: str) -> str:
    """Plotly hover text with name, value and unit."""
    return f"{name}: %{{y:.4g}} {channel.unit}<extra></extra>"


def time_layout(
    channel: ChannelLabel, traces: list[dict[str, Any]], values: np.ndarray | None = None, limits: Sequence[float] = ()
) -> dict[str, Any]:
    """Layout for a channel over time; logarithmic where the channel is and its values span more than a factor of 5.

    Of the `values` (runs, m) of a channel that is not, a few runs far beyond the others do not stretch the axis, which
    includes the `limits`; where many are, it is logarithmic.
    """
    layout = chart_layout("", f"[{channel.unit}]" if channel.unit else "[-]")
    layout["xaxis"]["ticksuffix"] = " s"
    layout["hovermode"] = "x unified"
    layout["legend"] = {"orientation": "h", "x": 0, "y": -0.13, "yanchor": "top", "font": {"size": 11}}
    if channel.logarithmic and _spans_decades(traces):
        minor = {"showgrid": True, "gridcolor": FAINT}
        layout["yaxis"].update(type="log", tickformat="~g", dtick=_log_tick_step(traces), minor=minor)
    elif not channel.logarithmic:
        layout["yaxis"]["rangemode"] = "tozero"
        _fit_far_values(layout, np.zeros(0) if values is None else values, limits)
    return layout


def _fit_far_values(layout: dict[str, Any], values: np.ndarray, limits: Sequence[float]) -> None:
    """Clips the vertical axis, with the count of runs beyond in a note, or makes it logarithmic, where it must be."""
    defined = values[np.isfinite(values).any(axis=1)] if values.size else values
    if not defined.size:
        return
    maxima = np.nanmax(np.where(np.isfinite(defined), defined, np.nan), axis=1)
    _, high = axis_ends(maxima, limits)
    if high < float(maxima.max()):
        count = int(np.sum(maxima > high))
        layout["yaxis"]["range"] = [min(0.0, float(np.nanmin(defined))), 1.05 * high]
        text = f"{count} {'run' if count == 1 else 'runs'} beyond, to {format_number(float(maxima.max()), 3)}"
        place = {"xref": "paper", "yref": "paper", "x": 1, "y": 1, "showarrow": False}
        layout["annotations"] = [{"text": text, **place}]
    elif spans_decades(defined):
        layout["yaxis"].update(type="log", rangemode="normal")


def _spans_decades(traces: list[dict[str, Any]]) -> bool:
    """Whether values differ by more than a factor of 5, so that a linear axis would hide the small ones."""
    shown = [value for trace in traces for value in trace["y"] if value is not None]
    return not shown or max(shown) > 5.0 * min(shown)


def _log_tick_step(traces: list[dict[str, Any]]) -> str | int:
    """Tick step of plotly: 1, 2, 5 in each decade if few decades are shown, else one tick per decade."""
    shown = [value for trace in traces for value in trace["y"] if value is not None]
    return "D2" if shown and max(shown) < 3e3 * min(shown) else 1


def histogram_chart(label: MetricLabel, values: np.ndarray, limits: Sequence[Limit] = ()) -> Chart:
    """Histogram of `values` (n,), all finite; median solid, p99 (p1 where low is bad) dotted, limits dashed and named.

    Bars beyond a limit have another colour. A limit lies at the edge, with an arrow, where it is far from all values.
    A few values far beyond the others are counted at the edge; where many are, the axis is logarithmic.
    """
    low, high = axis_ends(values)
    is_log = low == values.min() and high == values.max() and spans_decades(values)
    counts, edges = _decade_bins(values) if is_log else histogram_bins(values[(values >= low) & (values <= high)])
    tail = 1 if label.low_is_bad else 99
    middles = (edges[:-1] + edges[1:]) / 2.0
    beyond = np.zeros(len(counts), dtype=bool)
    for limit in limits:
        beyond |= limit.is_broken_by(middles)
    bars = {
        "type": "bar",
        "x": rounded_values(middles),
        "y": counts.tolist(),
        "width": rounded_values(np.diff(edges)),
        "marker": {"color": [VERMILLION if one else BLUE for one in beyond], "opacity": 0.75, "line": {"width": 0}},
        "hovertemplate": "%{y} runs near %{x}<extra></extra>",
    }
    layout = chart_layout(label.unit, "runs")
    layout["bargap"] = 0
    layout["xaxis"].update({"type": "log"} if is_log else {})
    statistics = (("solid", "median", np.percentile(values, 50)), ("dot", f"p{tail}", np.percentile(values, tail)))
    layout["shapes"] = [
        *(_vertical_line(float(x), dash, name) for dash, name, x in statistics if low <= x <= high),
        *(_limit_shape(limit, float(edges[0]), float(edges[-1])) for limit in limits),
        *_counts_beyond(values, low, high, float(edges[0]), float(edges[-1])),
    ]
    layout["margin"] = {"l": 42, "r": 10, "t": 6, "b": 36}
    return {"data": [bars], "layout": layout}


def _counts_beyond(values: np.ndarray, low: float, high: float, left: float, right: float) -> list[dict[str, Any]]:
    """Lines at the edges of an axis, with the number of values beyond."""
    below, above = int(np.sum(values < low)), int(np.sum(values > high))
    found = []
    for count, place, text in (
        (below, left, f"\N{LEFTWARDS ARROW} {below} below"),
        (above, right, f"{above} beyond \N{RIGHTWARDS ARROW}"),
    ):
        if count:
            line = {"color": MUTED, "width": 1.2, "dash": "dashdot"}
            ends = {"xref": "x", "yref": "paper", "x0": place, "x1": place, "y0": 0, "y1": 1}
            found.append({"type": "line", "name": "beyond", "line": line, "label": {"text": text}, **ends})
    return found


def histogram_bins(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Counts (k,) and bin edges (k + 1,) of `values` (n,), all finite; bins of integers are centred on integers."""
    low, high = float(values.min()), float(values.max())
    if np.all(values == np.round(values)):
        step = max(1.0, np.ceil((high - low + 1.0) / _MAX_BINS))
        return np.histogram(values, bins=np.arange(low - 0.5, high + 0.5 + step, step))
    bins = int(np.clip(np.ceil(np.sqrt(len(values))), 6, _MAX_BINS))
    margin = 1e-6 * max(abs(low), abs(high))
    wide = high - low > margin
    return np.histogram(values, bins=bins, range=(low, high) if wide else (low - margin, high + margin))


def _decade_bins(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Counts (k,) and bin edges (k + 1,) of positive `values` (n,), of equal width on a logarithmic axis."""
    counts, exponents = np.histogram(np.log(values), bins=int(np.clip(np.ceil(np.sqrt(len(values))), 6, _MAX_BINS)))
    edges = np.exp(exponents)
    edges[0], edges[-1] = values.min(), values.max()
    return counts, edges


def _limit_shape(limit: Limit, low: float, high: float) -> dict[str, Any]:
    """Line at the limit, or at the nearer end of the values with an arrow where it is far away."""
    reach = _FARTHEST_SPANS * (high - low)
    if limit.value > high + reach:
        return limit_line(high, f"{limit.text} \N{RIGHTWARDS ARROW}", upright=True)
    if limit.value < low - reach:
        return limit_line(low, f"\N{LEFTWARDS ARROW} {limit.text}", upright=True)
    return limit_line(limit.value, limit.text, upright=True)


def _vertical_line(x: float, dash: str, name: str) -> dict[str, Any]:
    line = {"color": INK, "width": 1.4, "dash": dash}
    ends = {"xref": "x", "yref": "paper", "x0": x, "x1": x, "y0": 0, "y1": 1}
    return {"type": "line", "name": name, "showlegend": True, "line": line, **ends}
