"""Filter consistency: NEES, NIS, whiteness of innovations and 3-sigma coverage."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.analysis.statistics.filter_consistency_intervals import (
    AverageNees,
    average_nees,
    mean_square_interval,
    whiteness_bound,
)
from rpojax.analysis.statistics.intervals import coverage_per_axis
from rpojax.metrics.metric_catalogue import find
from rpojax.report.campaign_results import CampaignResults, probability_interval, runs_are_independent
from rpojax.report.figures.colours import BLUE
from rpojax.report.figures.plotly_charts import (
    MAX_POINTS,
    Chart,
    add_reference_lines,
    band_traces,
    channel_line,
    rounded_values,
    time_layout,
)
from rpojax.report.labels import (
    ChannelLabel,
    format_interval,
    format_number,
    in_display_order,
    metric_label,
    of_all_servicers,
)
from rpojax.report.metric_statistics import mean_confidence_interval

_INTERVAL_FILL = "rgba(0, 158, 115, 0.25)"
_NEES_CHANNELS = (
    (ChannelLabel("nees", "Average NEES of 12 position and velocity components", "", logarithmic=True), 12),
    (ChannelLabel("nees_relative", "Average NEES of the 6 components of the relative state", "", logarithmic=True), 6),
)
"""NEES channels over time and their numbers of components."""
_COVERAGE = "sigma3_coverage"
LOW_COVERAGE = 0.95
"""Coverage of a run below which its filter is not to be trusted."""
_SOURCES = {"gps": "GPS", "box": "boxes"}
_WHITENESS = "_innovation_lag1"
"""End of the names of correlations of innovations, after that of the sensor."""
_EXPECTED_OUTSIDE = 0.05
_INTERPRETATIONS = {
    "nees": (
        "errors are larger than the covariance says: the filter is too sure of itself",
        "errors are smaller than the covariance says: the filter is cautious and gives measurements more weight than "
        "they need",
    ),
    "nis": (
        "measurements stray further from what the filter expects than it believes: too little noise is assumed",
        "measurements stray less than the filter believes: too much noise is assumed, and information is wasted",
    ),
    "coverage": (
        "errors keep within 3 sigma more often than normal ones: the filter is cautious",
        "errors leave 3 sigma more often than normal ones: the filter is too sure of itself, or its errors have tails",
    ),
}


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


@dataclass(frozen=True)
class ConsistencyRow:
    """Row of a table: quantity, text of the cells, interpretation."""

    quantity: str
    cells: list[str]
    interpretation: str


def content(campaign: CampaignResults) -> dict[str, Any]:
    """Part of report.json: `means` of NEES, NIS and coverage, `over_time` and `whiteness`, and a share of runs.

    All runs that reached their end count, in whatever state.
    """
    return {
        "means": [_mean_entry(campaign, name) for name in (*_squares(campaign), _COVERAGE) if name in campaign.metrics],
        "over_time": [
            entry for channel, size in _NEES_CHANNELS for entry in _over_time_entries(campaign, channel.name, size)
        ],
        "whiteness": [
            _whiteness_entry(campaign, name)
            for name in in_display_order(of_all_servicers(campaign.metrics))
            if name.endswith(_WHITENESS) and _degrees_of_freedom(f"nis_{name.removesuffix(_WHITENESS)}_mean") > 0
        ],
        "sigma3_coverage_low_runs_fraction": _low_coverage_fraction(campaign),
    }


def _squares(campaign: CampaignResults) -> list[str]:
    """Names of normalised squares in display order."""
    return [
        name
        for name in in_display_order(of_all_servicers(campaign.metrics))
        if "@" not in name and _degrees_of_freedom(name) > 0
    ]


def _degrees_of_freedom(name: str) -> int:
    """Degrees of freedom of a normalised square, 0 for another metric."""
    metric = find(name)
    return 0 if metric is None or metric.degrees_of_freedom is None else metric.degrees_of_freedom


def charts(campaign: CampaignResults) -> dict[str, tuple[ChannelLabel, Chart]]:
    """Channel and chart of each average NEES over time by channel name; no interval if runs are not independent."""
    ended = np.asarray(campaign.reached_end, dtype=bool)
    found = {}
    for channel, components in _NEES_CHANNELS:
        values = campaign.traces.get(channel.name)
        if values is not None and np.isfinite(values[ended]).any():
            nees = average_nees(np.asarray(values[ended], dtype=np.float64), components)
            found[channel.name] = (
                channel,
                average_nees_chart(channel, campaign.trace_time_s, nees, runs_are_independent(campaign)),
            )
    return found


def mean_rows(consistency: Mapping[str, Any]) -> list[ConsistencyRow]:
    """Rows of means: mean, its interval from the spread between runs, expectation, chi-square interval."""
    return [
        ConsistencyRow(
            metric_label(entry["name"]).title,
            [
                format_number(entry["mean"]),
                format_interval(entry["interval_95"]),
                format_number(entry["expected"]),
                format_interval(entry["chance_interval_95"]),
            ],
            entry["says"],
        )
        for entry in consistency["means"]
    ]


def time_rows(consistency: Mapping[str, Any]) -> list[ConsistencyRow]:
    """Rows of instants: interval of the average over runs, fractions of instants inside, above and below it."""
    return [
        ConsistencyRow(
            metric_label(f"{entry['name']}_mean").title,
            [format_interval(entry["interval_95"]), *(_percent(entry[key]) for key in ("inside", "above", "below"))],
            entry["says"],
        )
        for entry in consistency["over_time"]
    ]


def whiteness_rows(consistency: Mapping[str, Any]) -> list[ConsistencyRow]:
    """Rows of innovations one tick apart: mean correlation, bound, fraction of runs beyond it with its interval."""
    return [
        ConsistencyRow(
            metric_label(entry["name"]).title,
            [
                format_number(entry["mean"], 2),
                f"±{format_number(entry['bound'], 2)}",
                _percent(entry["outside"]),
                _percent_interval(entry["outside_interval_95"]),
            ],
            entry["says"],
        )
        for entry in consistency["whiteness"]
    ]


def low_coverage_text(consistency: Mapping[str, Any]) -> str | None:
    """Share of runs with a low coverage as text, None if unknown."""
    share = consistency["sigma3_coverage_low_runs_fraction"]
    return None if share is None else _percent(share)


def _low_coverage_fraction(campaign: CampaignResults) -> float | None:
    """Share of runs whose coverage is low, which a mean over runs hides; None without a run that has one."""
    values = np.asarray(campaign.metrics.get(_COVERAGE, ()), dtype=np.float64)
    known = values[np.isfinite(values)]
    return float(np.mean(known < LOW_COVERAGE)) if len(known) else None


def _mean_entry(campaign: CampaignResults, name: str) -> dict[str, Any]:
    """Mean over runs compared with its expectation; each run is one sample, as its errors are correlated in time."""
    values = campaign.metrics[name]
    defined = np.asarray(values[np.isfinite(values)], dtype=np.float64)
    covers = name == _COVERAGE
    kind = "coverage" if covers else name.partition("_")[0]
    expected = coverage_per_axis(3.0) if covers else float(_degrees_of_freedom(name))
    confidence = mean_confidence_interval(defined) if runs_are_independent(campaign) else None
    return {
        "name": name,
        "runs": len(defined),
        "mean": float(defined.mean()) if len(defined) else None,
        "interval_95": None if confidence is None else confidence[0],
        "interval_method": None if confidence is None else confidence[1],
        "expected": expected,
        "chance_interval_95": None
        if covers or not runs_are_independent(campaign)
        else _chi_square_interval(campaign, name, len(defined)),
        "says": _interpret_mean(kind, confidence[0], expected)
        if confidence is not None
        else _no_interpretation(campaign),
    }


def _chi_square_interval(campaign: CampaignResults, name: str, runs: int) -> list[float] | None:
    """Chi-square interval of the mean: every innovation counts as independent, of NEES one instant per run."""
    updates = float(np.nansum(_update_counts(campaign, name))) if name.startswith("nis") else float(runs)
    return list(mean_square_interval(_degrees_of_freedom(name), round(updates))) if updates >= 1.0 else None


def _update_counts(campaign: CampaignResults, name: str) -> np.ndarray:
    """Number of updates of each run that reached its end (runs,), NaN where unknown."""
    scenario = campaign.info.get("scenario", {})
    ticks = float(scenario.get("duration_s", np.nan)) * float((scenario.get("rates") or {}).get("camera_hz", np.nan))
    sensor = name.removeprefix("nis_").removesuffix("_mean").removesuffix(_WHITENESS)
    if sensor == "gps":
        fractions = np.ones(len(campaign.reached_end))
    else:
        of_sensor = "visible_fraction" if sensor == "box" else f"{sensor}_used_fraction"
        fractions = campaign.metrics.get(of_sensor, np.full(len(campaign.reached_end), np.nan))
    return np.where(campaign.reached_end, ticks * fractions, np.nan)


def _no_interpretation(campaign: CampaignResults) -> str:
    """Reason why there is no interpretation without an interval."""
    if runs_are_independent(campaign):
        return "Nothing: too few runs to tell a departure from chance."
    return "Nothing, as the runs are not independent."


def _interpret_mean(kind: str, interval: Sequence[float], expected: float) -> str:
    low, high = interval
    if low > expected:
        return f"Above: {_INTERPRETATIONS[kind][0]}."
    if high < expected:
        return f"Below: {_INTERPRETATIONS[kind][1]}."
    return "No departure can be told from the spread between runs."


def _over_time_entries(campaign: CampaignResults, name: str, components: int) -> list[dict[str, Any]]:
    """Average over independent runs at each settled instant compared with its chi-square interval, if any."""
    values, ended = campaign.traces.get(name), np.asarray(campaign.reached_end, dtype=bool)
    if values is None or not ended.any() or not runs_are_independent(campaign):
        return []
    # The filter counts as settled after 1000 s, or a third of a shorter run, as in the metrics.
    settled = campaign.trace_time_s >= min(1000.0, float(campaign.trace_time_s[-1]) / 3.0)
    nees = np.asarray(values[ended][:, settled], dtype=np.float64)
    found = average_nees(nees, components)
    if not np.isfinite(found.mean).any():
        return []
    inside = 1.0 - found.fraction_above - found.fraction_below
    return [
        {
            "name": name,
            "components": found.components,
            "instants": int(np.isfinite(found.mean).sum()),
            "interval_95": [float(np.nanmin(found.low)), float(np.nanmax(found.high))],
            "inside": inside,
            "above": found.fraction_above,
            "below": found.fraction_below,
            "says": _interpret_instants(found.fraction_above, found.fraction_below, _departure_side(nees, components)),
        }
    ]


def _departure_side(nees: np.ndarray, components: int) -> int | None:
    """Side on which the mean of `nees` (runs, ticks) departs from its expectation: 0 above, 1 below, None neither."""
    known = nees[np.isfinite(nees).any(axis=1)]
    confidence = mean_confidence_interval(np.nanmean(known, axis=1))
    if confidence is None:
        return None
    low, high = confidence[0]
    if low > components:
        return 0
    return 1 if high < components else None


def _interpret_instants(above: float, below: float, side: int | None) -> str:
    """Departure only where the mean over runs agrees: instants are correlated."""
    if side is not None and (above, below)[side] > max((above, below)[1 - side], 2.0 * _EXPECTED_OUTSIDE):
        return f"Mostly {('above', 'below')[side]}: {_INTERPRETATIONS['nees'][side]}."
    return "No departure can be told from the shares of instants alone."


def _whiteness_entry(campaign: CampaignResults, name: str) -> dict[str, Any]:
    values = np.asarray(campaign.metrics[name], dtype=np.float64)
    sensor = name.removesuffix(_WHITENESS)
    products = _degrees_of_freedom(f"nis_{sensor}_mean") * _update_counts(campaign, name)
    known = np.isfinite(values) & (products >= 1.0)
    bounds = np.array([whiteness_bound(count) for count in products[known].astype(int).tolist()])
    beyond = int(np.sum(np.abs(values[known]) > bounds))
    runs = int(known.sum())
    interval = probability_interval(campaign, beyond, runs)
    mean = float(values[known].mean()) if runs else None
    return {
        "name": name,
        "runs": runs,
        "mean": mean,
        "bound": float(np.median(bounds)) if runs else None,
        "outside": beyond / runs if runs else None,
        "outside_interval_95": interval,
        "expected_outside": _EXPECTED_OUTSIDE,
        "says": _no_interpretation(campaign)
        if mean is None or interval is None
        else _interpret_whiteness(_SOURCES.get(sensor, sensor.replace("_", " ")), mean, interval),
    }


def _interpret_whiteness(source: str, mean: float, interval: Sequence[float]) -> str:
    if interval[0] <= _EXPECTED_OUTSIDE:
        return "No departure can be told from white innovations, beyond the bound in 5 % of runs."
    if mean > 0.0:
        return (
            f"Innovations of {source} resemble the ones before: the filter follows too slowly, or errors of the "
            "measurements last longer than it models."
        )
    return f"Innovations of {source} alternate: the filter follows the noise of its measurements."


def _percent_interval(ends: Sequence[float] | None) -> str:
    return format_number(None) if ends is None else " to ".join(map(_percent, ends))


def _percent(fraction: float | None) -> str:
    return format_number(None) if fraction is None else f"{100.0 * fraction:.1f}\N{NO-BREAK SPACE}%"
