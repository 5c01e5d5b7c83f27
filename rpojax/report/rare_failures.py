"""Rare failures in the report: estimated probabilities, and requirements that plain runs cannot verify."""

import itertools
import json
import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from rpojax.analysis.reliability.simulated_failures.estimate_folder import RESULT_NAME, read_result
from rpojax.analysis.statistics import rare_requirements
from rpojax.analysis.statistics.intervals import clopper_pearson_interval
from rpojax.campaign.storage import safe_paths
from rpojax.report import shell_commands
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.colours import BLUE, INK, SHADE, VERMILLION
from rpojax.report.figures.plotly_charts import Chart, chart_layout, limit_line
from rpojax.report.labels import format_number
from rpojax.scenario.plugins.plugin_registry import FROM_PYTHON

FOLDER_NAME = "probability"
"""Folder in that of the campaign in which estimates are found."""
_MOST_DISPERSIONS = 6
_VERDICTS = {
    "met": "the requirement is met",
    "violated": "the requirement is violated",
    "open": "the requirement is left open",
}
_MOST_BARS: Final = 8
_ROOM: Final = 3.0
"""Factor from the least to the leftmost probability shown."""


def content(campaign: CampaignResults) -> list[dict[str, Any]]:
    """Part of report.json: each estimate, and each requirement that plain runs cannot verify with its command.

    Raises:
        ResultError: a file of an estimate is not what was written, or lies elsewhere.
    """
    estimates = _estimates(campaign)
    found = [{"kind": "estimate", "same_scenario": same, "estimate": each} for each, same in estimates]
    known = {each["failure"]["metric"] for each, _ in estimates if each["requirement"] is not None}
    for entry in campaign.info.get("scenario", {}).get("requirements") or []:
        if rare_requirements.is_rare(entry["probability"]) and not (entry.keys() & {"phase", "from_s", "to_s"}):
            if entry["metric"] in known or entry.get("outcome") is not None:
                continue
            found.append(_wanted(campaign, entry))
    return found


def _wanted(campaign: CampaignResults, entry: Mapping[str, Any]) -> dict[str, Any]:
    """A requirement without an estimate: the runs that plain sampling needs, and the command if there is one."""
    metric, scenario = str(entry["metric"]), shell_commands.scenario_copy(campaign)
    out, plugin = scenario.parent / FOLDER_NAME / metric, shell_commands.plugin_of(campaign)
    possible = rare_requirements.can_be_estimated(metric, len(campaign.servicer_names)) and plugin != FROM_PYTHON
    return {
        "kind": "wanted",
        "metric": entry["metric"],
        "allowed": 1.0 - entry["probability"],
        "plain_runs": rare_requirements.plain_runs(entry["probability"], entry["consumer_risk"]),
        "command": rare_requirements.command(scenario, metric, out, plugin) if possible else "",
    }


def _estimates(campaign: CampaignResults) -> list[tuple[dict[str, Any], bool]]:
    """Finished estimates of the folder by name, and whether they are of the campaign's scenario."""
    root = campaign.directory / FOLDER_NAME
    safe_paths.check_no_links(campaign.directory, root)
    if not root.is_dir():
        return []
    found = []
    own = json.dumps(campaign.info.get("scenario_hash"))
    for directory in sorted(root.iterdir()):
        safe_paths.check_no_links(campaign.directory, directory)
        if directory.is_dir() and (directory / RESULT_NAME).is_file():
            estimate = read_result(directory)
            found.append((estimate, json.dumps(estimate.get("scenario_hash")) == own))
    return found


def sentences(content: Mapping[str, Any]) -> list[str]:
    """Sentences on an estimate: probability, requirement, accuracy, method, and warnings."""
    low, high = content["interval_95"]
    cov = content["coefficient_of_variation"]
    found = [
        f"{content['failure']['words']}: probability {content['probability']:.3g}, "
        f"95 % interval {low:.3g} to {high:.3g}{'' if content['trusted'] else '; NOT trusted'}",
    ]
    requirement = content["requirement"]
    if requirement is not None:
        allowed = requirement["allowed_probability_of_failure"]
        found.append(f"allowed is {allowed:.3g}: {_VERDICTS[requirement['verdict']]}")
    accuracy = "no coefficient of variation" if cov is None else f"coefficient of variation {100.0 * cov:.2g} %"
    equal = content["plain_runs_for_equal_accuracy"]
    against = "" if equal is None else f"; plain sampling would take {equal:,.0f} runs"
    found.append(f"{content['evaluations']} simulated runs by method {content['method']}, {accuracy}{against}")
    found.append(f"method: {content['reason']}")
    found += [f"note: {warning}" for warning in content["warnings"]]
    if content["remark"]:
        found.append(f"note: {content['remark']}")
    return found


def level_rows(levels: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Rows of the stages of an estimate: name, runs, probability, margin, acceptance of chains."""
    return [
        [
            level["name"],
            str(level["evaluations"]),
            _short(level["probability"]),
            format_number(level["threshold"]),
            format_number(level["acceptance"], 2),
        ]
        for level in levels
    ]


def design_point_rows(points: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Design points with the dispersions that are farthest from their median."""
    return [
        {
            "distance": f"{point['distance_sigmas']:.2f}",
            "share": f"{100.0 * point['share']:.0f} %",
            "dispersions": [_dispersion_cells(dispersion) for dispersion in point["dispersions"][:_MOST_DISPERSIONS]],
        }
        for point in points
    ]


def failing_run_rows(runs: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Rows of the most likely failing runs: distance, what is unusual in them, command."""
    return [
        [
            f"{run['distance_sigmas']:.2f}",
            "; ".join(
                f"{dispersion['name']} {_numbers(dispersion['sigmas'].values(), '+.1f')}"
                for dispersion in run["dispersions"][:3]
            ),
            run["command"],
        ]
        for run in runs
    ]


def _dispersion_cells(entry: Mapping[str, Any]) -> list[str]:
    """Name, sigmas, value and nominal value of a dispersion."""
    values, nominal = (
        _numbers(np.concatenate([np.ravel(each) for each in entry[side].values()]).tolist(), ".5g")
        for side in ("values", "nominal")
    )
    return [entry["name"], _numbers(entry["sigmas"].values(), "+.2f"), values, nominal]


def _numbers(values: Any, form: str) -> str:
    return ", ".join(format(value, form) for value in values)


def _short(value: float | None) -> str:
    return format_number(None) if value is None or not math.isfinite(value) else f"{value:.3g}"


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
    """Intervals of the estimate and of as many plain runs, on a logarithmic axis with the allowed probability."""
    runs = max(1, int(content["evaluations"]))
    probability = float(content["probability"])
    failures = round(probability * runs)
    rows = [
        ("as many plain runs", failures / runs, clopper_pearson_interval(failures, runs), SHADE),
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
        x, y = [float(level["threshold"]) for level in search], [float(probability) for probability in reached]
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
    """Chart of the dispersions farthest from their median [sigmas], and its meaning; None if nothing is dispersed."""
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
    every = [(name, float(value)) for dispersion in dispersions for name, value in dispersion["sigmas"].items()]
    return sorted(every, key=lambda pair: abs(pair[1]))[-_MOST_BARS:]


def section_values(entries: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]] | None:
    """Estimates and wanted estimates of the section of a campaign's report; None if there are none."""
    if not entries:
        return None
    estimates = [
        {**estimate_values(entry["estimate"], charts), "same_scenario": entry["same_scenario"]}
        for entry, charts in _with_charts(entries)
    ]
    return {"estimates": estimates, "wanted": [entry for entry in entries if entry["kind"] == "wanted"]}


def section_charts(entries: Sequence[Mapping[str, Any]]) -> dict[str, Chart]:
    """Charts of the estimates of that section by name."""
    return {chart.name: chart.chart for _, charts in _with_charts(entries) for chart in charts}


def estimate_values(content: Mapping[str, Any], charts: Sequence[NamedChart]) -> dict[str, Any]:
    """Sentences, charts and rows of one estimate."""
    headline, *further = sentences(content)
    return {
        "trusted": content["trusted"],
        "headline": headline,
        "sentences": further,
        "charts": charts,
        "levels": level_rows(content["levels"]),
        "points": design_point_rows(content["design_points"]),
        "runs": failing_run_rows(content["failing_runs"]),
        "noise": content["noise"],
        "unmapped": content["unmapped"],
    }


def _with_charts(entries: Sequence[Mapping[str, Any]]) -> list[tuple[Mapping[str, Any], list[NamedChart]]]:
    estimates = [entry for entry in entries if entry["kind"] == "estimate"]
    return [(entry, charts(entry["estimate"], f"probability-{number}")) for number, entry in enumerate(estimates)]
