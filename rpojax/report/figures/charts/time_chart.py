"""Lines and layout of charts that show a channel over time."""

from typing import Any

import numpy as np

from rpojax.report.figures.charts.plotly_charts import chart_layout, line_trace, rounded_values
from rpojax.report.figures.colours import FAINT
from rpojax.report.labels import ChannelLabel

MAX_POINTS = 800
"""Most points of a line, so that the page stays small."""


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


def time_layout(channel: ChannelLabel, traces: list[dict[str, Any]]) -> dict[str, Any]:
    """Layout for a channel over time; logarithmic where the channel is and its values span more than a factor of 5."""
    layout = chart_layout("", f"[{channel.unit}]" if channel.unit else "[-]")
    layout["xaxis"]["ticksuffix"] = " s"
    layout["hovermode"] = "x unified"
    layout["legend"] = {"orientation": "h", "x": 0, "y": -0.13, "yanchor": "top", "font": {"size": 11}}
    if channel.logarithmic and _spans_decades(traces):
        minor = {"showgrid": True, "gridcolor": FAINT}
        layout["yaxis"].update(type="log", tickformat="~g", dtick=_log_tick_step(traces), minor=minor)
    elif not channel.logarithmic:
        layout["yaxis"]["rangemode"] = "tozero"
    return layout


def _spans_decades(traces: list[dict[str, Any]]) -> bool:
    """Whether values differ by more than a factor of 5, so that a linear axis would hide the small ones."""
    shown = [value for trace in traces for value in trace["y"] if value is not None]
    return not shown or max(shown) > 5.0 * min(shown)


def _log_tick_step(traces: list[dict[str, Any]]) -> str | int:
    """Plotly tick step: 1, 2, 5 in each decade if few decades are shown, else one tick per decade."""
    shown = [value for trace in traces for value in trace["y"] if value is not None]
    return "D2" if shown and max(shown) < 3e3 * min(shown) else 1
