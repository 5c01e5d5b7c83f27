"""Histogram of a metric over runs, with the limits of its requirements."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from rpojax.report.figures.charts.plotly_charts import Chart, chart_layout, limit_line, rounded_values
from rpojax.report.figures.colours import BLUE, INK, VERMILLION
from rpojax.report.figures.requirement_limits import Limit
from rpojax.report.labels import MetricLabel

_MAX_BINS = 36
_FARTHEST_SPANS: Final = 12.0
"""A limit farther from the values than so many times their span is marked at the edge, so that they stay visible."""


def histogram_chart(label: MetricLabel, values: np.ndarray, limits: Sequence[Limit] = ()) -> Chart:
    """Histogram of `values` (n,), all finite; median solid, p99 (p1 where low is bad) dotted, limits dashed and named.

    Bars beyond a limit have another colour. A limit lies at the edge, with an arrow, where it is far from all values.
    """
    counts, edges = histogram_bins(values)
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
    layout["shapes"] = [
        _vertical_line(float(np.percentile(values, 50)), "solid", "median"),
        _vertical_line(float(np.percentile(values, tail)), "dot", f"p{tail}"),
        *(_limit_shape(limit, float(edges[0]), float(edges[-1])) for limit in limits),
    ]
    layout["margin"] = {"l": 42, "r": 10, "t": 6, "b": 36}
    return {"data": [bars], "layout": layout}


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
