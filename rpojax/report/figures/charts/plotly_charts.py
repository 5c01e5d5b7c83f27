"""Building blocks of charts: lines, bands, limits, layout. Charts are dictionaries in plotly's format.

The page draws them itself (`page/assets/charts.js`), the part of the format that is used here: `scatter` traces with
lines, points, bands and stacked areas, `bar` traces, straight shapes with labels; linear, logarithmic and categorical
axes.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rpojax.report.figures.colours import BLUE, FONT, GRID, INK, MUTED, VERMILLION

Chart = dict[str, Any]
"""Plotly figure: `data` (traces) and `layout`."""
EMPTY_TITLE = {"text": ""}


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
