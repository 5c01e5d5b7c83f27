"""Histogram of a metric over runs."""

from typing import Any

import numpy as np

from rpojax.report.figures.charts.plotly_charts import Chart, chart_layout, rounded_values
from rpojax.report.figures.colours import BLUE, VERMILLION
from rpojax.report.labels import MetricLabel

_MAX_BINS = 36


def histogram_chart(label: MetricLabel, values: np.ndarray) -> Chart:
    """Histogram of `values` (n,), all finite; median solid, p99 (p1 where low is bad) dashed."""
    counts, edges = histogram_bins(values)
    bars = {
        "type": "bar",
        "x": rounded_values((edges[:-1] + edges[1:]) / 2.0),
        "y": counts.tolist(),
        "width": rounded_values(np.diff(edges)),
        "marker": {"color": BLUE, "opacity": 0.75, "line": {"width": 0}},
        "hovertemplate": "%{y} runs near %{x}<extra></extra>",
    }
    layout = chart_layout(label.unit, "runs")
    layout["bargap"] = 0
    layout["yaxis"]["automargin"] = True
    layout["showlegend"] = False
    layout["shapes"] = [
        _vertical_line(float(np.percentile(values, 50)), "solid"),
        _vertical_line(float(np.percentile(values, 1 if label.low_is_bad else 99)), "dash"),
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


def _vertical_line(x: float, dash: str) -> dict[str, Any]:
    line = {"color": VERMILLION, "width": 1.6, "dash": dash}
    return {"type": "line", "xref": "x", "yref": "paper", "x0": x, "x1": x, "y0": 0, "y1": 1, "line": line}
