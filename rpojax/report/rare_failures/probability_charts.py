"""Charts of an estimated probability: its interval, the tail of the limit state, and what is unusual in failures."""

import itertools
import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from rpojax.analysis.reliability.rare_events.probability_estimate import binomial_interval
from rpojax.report.figures.charts.plotly_charts import Chart, chart_layout, limit_line
from rpojax.report.figures.colours import BLUE, INK, SHADE, VERMILLION

_MOST_BARS: Final = 8
_ROOM: Final = 3.0
"""Factor from the least to the leftmost probability shown."""


@dataclass(frozen=True)
class NamedChart:
    """A chart with the name of its place, title, meaning, and CSS class of its height."""

    name: str
    title: str
    meaning: str
    chart: Chart
    size: str


def charts(content: Mapping[str, Any], prefix: str = "probability") -> list[NamedChart]:
    """Charts of the content of an estimate, those that its method allows."""
    found = [
        NamedChart(
            f"{prefix}-interval",
            "Probability of failure",
            "Points, and 95 % intervals. As many plain runs would have given the lower one; one that reaches the left "
            "edge begins at zero.",
            _interval_chart(content),
            "small",
        )
    ]
    if (tail := _tail_chart(content)) is not None:
        meaning = "How likely a run is to come this near to failure; it fails at a margin of zero."
        found.append(NamedChart(f"{prefix}-tail", "Tail of the limit state", meaning, tail, "middle"))
    if (unusual := _unusual_chart(content)) is not None:
        chart, meaning = unusual
        found.append(NamedChart(f"{prefix}-unusual", "Most likely failure", meaning, chart, "middle"))
    return found


def _interval_chart(content: Mapping[str, Any]) -> Chart:
    """Estimate with its interval, beside that of as many plain runs, on a logarithmic axis with what is allowed."""
    runs = max(1, int(content["evaluations"]))
    probability = float(content["probability"])
    failures = round(probability * runs)
    rows = [
        ("as many plain runs", failures / runs, binomial_interval(failures, runs), SHADE),
        (f"method {content['method']}", probability, tuple(content["interval_95"]), BLUE),
    ]
    allowed = None if content["requirement"] is None else content["requirement"]["allowed_probability_of_failure"]
    shown = [value for _, point, interval, _ in rows for value in (point, *interval)] + [allowed or 0.0]
    left = max(min((value for value in shown if value > 0.0), default=1.0) / _ROOM, 1e-300)
    traces: list[dict[str, Any]] = []
    for name, point, interval, color in rows:
        low, high = (max(value, left) for value in interval)
        bar = {"type": "scatter", "mode": "lines", "x": [low, high], "y": [name, name], "name": name}
        traces.append({**bar, "line": {"color": color, "width": 4.0}})
        if point > 0.0:
            marker = {"color": color, "size": 11}
            dot = {"type": "scatter", "mode": "markers", "x": [point], "y": [name], "marker": marker}
            traces.append({**dot, "name": name, "hovertemplate": f"{name}: %{{x:.3g}}"})
    layout = chart_layout("probability", "")
    layout["xaxis"] |= {"type": "log", "range": [math.log10(left), math.log10(min(1.0, _ROOM * max(shown)))]}
    layout["yaxis"] |= {"type": "category"}
    layout["showlegend"] = False
    layout["shapes"] = [] if not allowed else [limit_line(allowed, f"allowed {allowed:.3g}", upright=True)]
    return {"data": traces, "layout": layout}


def _tail_chart(content: Mapping[str, Any]) -> Chart | None:
    """Probability of a margin at or below each level, a line for each search; None of a method without levels."""
    searches = [search for search in _searches(content["levels"]) if len(search) > 1]
    if not searches:
        return None
    traces = []
    for search in searches:
        reached = itertools.accumulate((level["probability"] for level in search), operator.mul)
        x, y = [float(level["threshold"]) for level in search], [float(each) for each in reached]
        line = {"type": "scatter", "mode": "lines", "x": x, "y": y, "name": "a search", "line": {"color": SHADE}}
        line["line"] |= {"width": 1.8}
        traces.append({**line, "hovertemplate": "margin %{x:.4g}: %{y:.3g}", "showlegend": not traces})
    if content["probability"] > 0.0:
        marker = {"color": BLUE, "size": 11}
        dot = {"type": "scatter", "mode": "markers", "x": [0.0], "y": [content["probability"]], "marker": marker}
        traces.append({**dot, "name": "estimate", "hovertemplate": "estimate: %{y:.3g}"})
    layout = chart_layout("margin to failure", "probability")
    layout["yaxis"] |= {"type": "log"}
    layout["shapes"] = [limit_line(0.0, "failure", upright=True)]
    return {"data": traces, "layout": layout}


def _searches(levels: Sequence[Mapping[str, Any]]) -> list[list[Mapping[str, Any]]]:
    """Levels of each search on its own: their margins fall, and the first of another one is greater again."""
    found: list[list[Mapping[str, Any]]] = []
    for level in levels:
        if level["threshold"] is None or not level["probability"]:
            continue
        if not found or level["threshold"] >= found[-1][-1]["threshold"]:
            found.append([])
        found[-1].append(level)
    return found


def _unusual_chart(content: Mapping[str, Any]) -> tuple[Chart, str] | None:
    """Sigmas of the dispersions farthest from their median, and of what; None where nothing is dispersed."""
    points, runs = content["design_points"], content["failing_runs"]
    if points:
        chosen, meaning = points[0], "Dispersions of the first design point, in sigmas from their median."
    elif runs:
        chosen, meaning = runs[0], "Dispersions of the most likely failing run, in sigmas from their median."
    else:
        return None
    sigmas = _farthest(chosen["dispersions"])
    if not sigmas:
        return None
    names, values = [name for name, _ in sigmas], [round(value, 3) for _, value in sigmas]
    bars = {"type": "bar", "orientation": "h", "x": values, "y": names, "hovertemplate": "%{y}: %{x:.3g} sigmas"}
    bars["marker"] = {"color": [VERMILLION if value > 0.0 else BLUE for value in values], "opacity": 0.75}
    layout = chart_layout("sigmas", "")
    layout["yaxis"] |= {"type": "category"}
    layout["showlegend"] = False
    zero = {"type": "line", "line": {"color": INK, "width": 1.0}, "xref": "x", "yref": "paper"}
    layout["shapes"] = [{**zero, "x0": 0.0, "x1": 0.0, "y0": 0, "y1": 1}]
    return {"data": [bars], "layout": layout}, meaning


def _farthest(dispersions: Sequence[Mapping[str, Any]]) -> list[tuple[str, float]]:
    """Names and sigmas of the numbers farthest from their median, the farthest last, which is drawn at the top."""
    every = [(name, float(value)) for each in dispersions for name, value in each["sigmas"].items()]
    return sorted(every, key=lambda pair: abs(pair[1]))[-_MOST_BARS:]
