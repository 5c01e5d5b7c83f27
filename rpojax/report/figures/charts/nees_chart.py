"""Average NEES over time with the interval of a consistent filter."""

from typing import Any

import numpy as np

from rpojax.analysis.statistics.consistency import AverageNees
from rpojax.report.figures.charts.plotly_charts import Chart, add_reference_lines, band_traces, rounded_values
from rpojax.report.figures.charts.time_chart import MAX_POINTS, channel_line, time_layout
from rpojax.report.figures.colours import BLUE
from rpojax.report.labels import ChannelLabel

_INTERVAL_FILL = "rgba(0, 158, 115, 0.25)"


def average_nees_chart(channel: ChannelLabel, time_s: np.ndarray, nees: AverageNees, with_interval: bool) -> Chart:
    """Chart of NEES averaged over runs against time [s], with its expectation and optionally its 95 % interval."""
    shown = np.flatnonzero(np.isfinite(nees.mean))
    shown = shown[:: max(1, -(-len(shown) // MAX_POINTS))]
    time = rounded_values(time_s[shown])
    traces: list[dict[str, Any]] = []
    if with_interval:
        low, high = rounded_values(nees.low[shown]), rounded_values(nees.high[shown])
        traces += band_traces(time, low, high, "95 % of a consistent filter", _INTERVAL_FILL)
    traces.append(channel_line(channel, time, nees.mean[shown], "average over runs", BLUE, 1.8))
    chart = {"data": traces, "layout": time_layout(channel, traces)}
    return add_reference_lines(chart, channel.unit, [(float(nees.components), "expected")])
