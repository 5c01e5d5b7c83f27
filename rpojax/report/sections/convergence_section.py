"""Convergence of estimates with the number of runs."""

from typing import Any

import numpy as np

from rpojax.analysis.statistics.convergence import MetricConvergence, metric_convergence, rate_convergence
from rpojax.campaign.storage.atomic_outputs import to_json_types
from rpojax.report.campaign_results import CampaignResults, runs_are_independent, select_key_metrics
from rpojax.report.figures.colours import BLUE, VERMILLION
from rpojax.report.figures.plotly_charts import Chart, band_traces, chart_layout, line_trace, rounded_values
from rpojax.report.labels import MetricLabel, metric_label

_MIN_RUNS = 20
_BAND = "rgba(0, 114, 178, 0.2)"


def content(campaign: CampaignResults) -> dict[str, Any] | None:
    """Part of report.json: failure rate, medians and tail quantiles of the key metrics over the first n runs.

    Intervals are None if runs are not independent; None with fewer than twenty runs.
    """
    failed = np.asarray(campaign.failed, dtype=bool)
    if len(failed) < _MIN_RUNS:
        return None
    rate, independent = rate_convergence(failed), runs_are_independent(campaign)
    entries = {name: _entry(name, _converge(campaign, name), independent) for name in select_key_metrics(campaign)}
    failure_rate = {
        "rate": rate.rate,
        "low_95": rate.low if independent else None,
        "high_95": rate.high if independent else None,
    }
    return to_json_types({"runs": rate.runs, "failure_rate": failure_rate, "metrics": entries})


def charts(convergence: dict[str, Any]) -> dict[str, tuple[str, Chart]]:
    """Title and chart of the failure rate and of every metric, by name; the axis of runs is logarithmic."""
    runs, rate = convergence["runs"], convergence["failure_rate"]
    found = {"failure_rate": ("Failure rate", _chart(runs, rate, "rate", ("low_95", "high_95"), None, "", ""))}
    for name, entry in convergence["metrics"].items():
        label = metric_label(name)
        found[name] = (label.title, _metric_chart(runs, entry, label))
    return found


def _converge(campaign: CampaignResults, name: str) -> MetricConvergence:
    values = np.asarray(campaign.metrics[name], dtype=np.float64)
    return metric_convergence(values, metric_label(name).low_is_bad)


def _entry(name: str, found: MetricConvergence, independent: bool) -> dict[str, Any]:
    _, tail, bound, _ = metric_label(name).tail_statistics
    return {
        "p50": found.median,
        "p50_low_95": found.median_low if independent else None,
        "p50_high_95": found.median_high if independent else None,
        tail: found.tail,
        bound: found.tail_bound if independent else None,
    }


def _metric_chart(runs: list[int], entry: dict[str, Any], label: MetricLabel) -> Chart:
    _, tail, bound, _ = label.tail_statistics
    return _chart(runs, entry, "p50", ("p50_low_95", "p50_high_95"), (tail, bound), label.unit, "median")


def _chart(
    runs: list[int],
    entry: dict[str, Any],
    middle: str,
    ends: tuple[str, str],
    tail: tuple[str, str] | None,
    unit: str,
    name: str,
) -> Chart:
    x = rounded_values(np.array(runs, dtype=np.float64))
    traces: list[dict[str, Any]] = []
    if entry[ends[0]] is not None:
        traces += band_traces(x, _rounded(entry[ends[0]]), _rounded(entry[ends[1]]), "95 % interval", _BAND)
    traces.append(line_trace(x, _rounded(entry[middle]), name or "fraction of runs", BLUE, 2.0))
    if tail is not None:
        traces.append(line_trace(x, _rounded(entry[tail[0]]), tail[0], VERMILLION, 1.6))
        if entry[tail[1]] is not None:
            traces.append(line_trace(x, _rounded(entry[tail[1]]), f"95 % bound of {tail[0]}", VERMILLION, 1.4, "dot"))
    layout = chart_layout("runs", f"[{unit}]" if unit else "[-]")
    layout["xaxis"] |= {"type": "log", "tickformat": "~g", "dtick": "D2" if runs[-1] < 1000 * runs[0] else 1}
    layout["margin"] = {"l": 56, "r": 10, "t": 6, "b": 40}
    layout["legend"] = {"orientation": "h", "x": 0, "y": -0.28, "yanchor": "top", "font": {"size": 10.5}}
    return {"data": traces, "layout": layout}


def _rounded(values: list[float | None]) -> list[float | None]:
    return rounded_values(np.array(values, dtype=np.float64))
