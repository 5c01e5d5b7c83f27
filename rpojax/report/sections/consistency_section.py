"""Whether the filter knows its own errors: NEES, NIS, whiteness of innovations and coverage."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.analysis.statistics.binomial_intervals import proportion_interval
from rpojax.analysis.statistics.filter_consistency import average_nees, coverage_per_axis, nis_interval, whiteness_bound
from rpojax.report.campaign_protocol import Results
from rpojax.report.figures.plotly_charts import Chart, average
from rpojax.report.labels import Channel, metric, number
from rpojax.report.sections.design_caveat import independent
from rpojax.report.sections.metric_statistics import interval_of_mean

_TRACES = (
    (Channel("nees", "Average NEES of 12 position and velocity components", "", logarithmic=True), 12),
    (Channel("nees_relative", "Average NEES of the 6 components of the relative state", "", logarithmic=True), 6),
)
"""Traces over time and how many components they are about."""
_SIZES = {"nees_mean": 12, "nees_relative_mean": 6, "nis_gps_mean": 3, "nis_box_mean": 3}
_COVERAGE = "sigma3_coverage"
_WHITENESS = {"gps_innovation_lag1": "GPS", "box_innovation_lag1": "boxes"}
_ROWS_OF_AN_UPDATE = 3
_EXPECTED_OUTSIDE = 0.05
_SAYS = {
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


@dataclass(frozen=True)
class Row:
    """One line of a table: quantity, cells of text, and what the value says."""

    quantity: str
    cells: list[str]
    says: str


def content(campaign: Results) -> dict[str, Any]:
    """Part of report.json: `means` of NEES, NIS and coverage, `over_time` and `whiteness`, completed runs only."""
    return {
        "means": [_mean(campaign, name) for name in (*_SIZES, _COVERAGE) if name in campaign.metrics],
        "over_time": [entry for channel, size in _TRACES for entry in _over_time(campaign, channel.name, size)],
        "whiteness": [_whiteness(campaign, name) for name in _WHITENESS if name in campaign.metrics],
    }


def charts(campaign: Results) -> dict[str, tuple[Channel, Chart]]:
    """Channel and chart of every average NEES over time, by the name of its trace; no interval without independence."""
    completed = np.asarray(campaign.completed, dtype=bool)
    drawn = {}
    for channel, components in _TRACES:
        values = campaign.traces.get(channel.name)
        if values is not None and np.isfinite(values[completed]).any():
            found = average_nees(np.asarray(values[completed], dtype=np.float64), components)
            drawn[channel.name] = (channel, average(channel, campaign.trace_time_s, found, independent(campaign)))
    return drawn


def mean_rows(found: Mapping[str, Any]) -> list[Row]:
    """Lines about means: found, interval of the mean from the spread between runs, expected, and chi-square's."""
    return [
        Row(
            metric(entry["name"]).title,
            [
                number(entry["mean"]),
                _interval(entry["interval_95"]),
                number(entry["expected"]),
                _interval(entry["chance_interval_95"]),
            ],
            entry["says"],
        )
        for entry in found["means"]
    ]


def time_rows(found: Mapping[str, Any]) -> list[Row]:
    """Lines about instants: interval of the average over runs, and the shares of instants in, above and below it."""
    return [
        Row(
            metric(f"{entry['name']}_mean").title,
            [_interval(entry["interval_95"]), *(_percent(entry[key]) for key in ("inside", "above", "below"))],
            entry["says"],
        )
        for entry in found["over_time"]
    ]


def whiteness_rows(found: Mapping[str, Any]) -> list[Row]:
    """Lines about innovations one tick apart: mean correlation, bound, share of runs beyond it with its interval."""
    return [
        Row(
            metric(entry["name"]).title,
            [
                number(entry["mean"], 2),
                f"±{number(entry['bound'], 2)}",
                _percent(entry["outside"]),
                _shares(entry["outside_interval_95"]),
            ],
            entry["says"],
        )
        for entry in found["whiteness"]
    ]


def _settled_from_s(time_s: np.ndarray) -> float:
    """1000 s, or a third of a shorter run, as for the metrics of navigation."""
    return min(1000.0, float(time_s[-1]) / 3.0)


def _mean(campaign: Results, name: str) -> dict[str, Any]:
    """Mean over runs against its expectation; each run counts once, as its errors are correlated in time."""
    values = campaign.metrics[name]
    defined = np.asarray(values[np.isfinite(values)], dtype=np.float64)
    covers = name == _COVERAGE
    kind = "coverage" if covers else name.partition("_")[0]
    expected = coverage_per_axis(3.0) if covers else float(_SIZES[name])
    made = interval_of_mean(defined) if independent(campaign) else None
    return {
        "name": name,
        "runs": len(defined),
        "mean": float(defined.mean()) if len(defined) else None,
        "interval_95": None if made is None else made[0],
        "interval_method": None if made is None else made[1],
        "expected": expected,
        "chance_interval_95": None if covers or not independent(campaign) else _chance(campaign, name, len(defined)),
        "says": _says(kind, made[0], expected) if made is not None else _silence(campaign),
    }


def _chance(campaign: Results, name: str, runs: int) -> list[float] | None:
    """Chi-square interval of the mean: an innovation of every update is independent, of NEES one instant of a run."""
    updates = float(np.nansum(_updates(campaign, name))) if name.startswith("nis") else float(runs)
    return list(nis_interval(_SIZES[name], round(updates))) if updates >= 1.0 else None


def _updates(campaign: Results, name: str) -> np.ndarray:
    """Number of updates of each completed run (runs,), NaN where it is not known."""
    scenario = campaign.info.get("scenario", {})
    ticks = float(scenario.get("duration_s", np.nan)) * float((scenario.get("rates") or {}).get("camera_hz", np.nan))
    if "gps" in name:
        shares = np.ones(len(campaign.completed))
    else:
        shares = campaign.metrics.get("visible_fraction", np.full(len(campaign.completed), np.nan))
    return np.where(campaign.completed, ticks * shares, np.nan)


def _silence(campaign: Results) -> str:
    """Why nothing is said where there is no interval."""
    if independent(campaign):
        return "Nothing: too few runs to tell a departure from chance."
    return "Nothing, as the runs are not independent."


def _says(kind: str, made: Sequence[float], expected: float) -> str:
    low, high = made
    if low > expected:
        return f"Above: {_SAYS[kind][0]}."
    if high < expected:
        return f"Below: {_SAYS[kind][1]}."
    return "No departure can be told from the spread between runs."


def _over_time(campaign: Results, name: str, components: int) -> list[dict[str, Any]]:
    """Average over independent runs at each settled instant against its chi-square interval, if there is any."""
    values, completed = campaign.traces.get(name), np.asarray(campaign.completed, dtype=bool)
    if values is None or not completed.any() or not independent(campaign):
        return []
    settled = campaign.trace_time_s >= _settled_from_s(campaign.trace_time_s)
    of_runs = np.asarray(values[completed][:, settled], dtype=np.float64)
    found = average_nees(of_runs, components)
    if not np.isfinite(found.mean).any():
        return []
    inside = 1.0 - found.share_above - found.share_below
    return [
        {
            "name": name,
            "components": found.components,
            "instants": int(np.isfinite(found.mean).sum()),
            "interval_95": [float(np.nanmin(found.low)), float(np.nanmax(found.high))],
            "inside": inside,
            "above": found.share_above,
            "below": found.share_below,
            "says": _says_of_instants(found.share_above, found.share_below, _side(of_runs, components)),
        }
    ]


def _side(of_runs: np.ndarray, components: int) -> int | None:
    """Where the mean of `of_runs` (runs, ticks) lies by the spread between runs: 0 above, 1 below, None if unknown."""
    known = of_runs[np.isfinite(of_runs).any(axis=1)]
    made = interval_of_mean(np.nanmean(known, axis=1))
    if made is None:
        return None
    low, high = made[0]
    if low > components:
        return 0
    return 1 if high < components else None


def _says_of_instants(above: float, below: float, side: int | None) -> str:
    """A verdict only where the mean over runs agrees: instants share their errors, so their shares alone give none."""
    if side is not None and (above, below)[side] > max((above, below)[1 - side], 2.0 * _EXPECTED_OUTSIDE):
        return f"Mostly {('above', 'below')[side]}: {_SAYS['nees'][side]}."
    return "No departure can be told from the shares of instants alone."


def _whiteness(campaign: Results, name: str) -> dict[str, Any]:
    values = np.asarray(campaign.metrics[name], dtype=np.float64)
    products = _ROWS_OF_AN_UPDATE * _updates(campaign, name)
    known = np.isfinite(values) & (products >= 1.0)
    bounds = np.array([whiteness_bound(count) for count in products[known].astype(int).tolist()])
    beyond = int(np.sum(np.abs(values[known]) > bounds))
    runs = int(known.sum())
    interval = proportion_interval(beyond, runs) if runs and independent(campaign) else None
    mean = float(values[known].mean()) if runs else None
    return {
        "name": name,
        "runs": runs,
        "mean": mean,
        "bound": float(np.median(bounds)) if runs else None,
        "outside": beyond / runs if runs else None,
        "outside_interval_95": None if interval is None else list(interval),
        "expected_outside": _EXPECTED_OUTSIDE,
        "says": _silence(campaign)
        if mean is None or interval is None
        else _says_of_whiteness(_WHITENESS[name], mean, interval),
    }


def _says_of_whiteness(source: str, mean: float, interval: tuple[float, float]) -> str:
    if interval[0] <= _EXPECTED_OUTSIDE:
        return "No departure can be told from white innovations, beyond the bound in 5 % of runs."
    if mean > 0.0:
        return (
            f"Innovations of {source} resemble the ones before: the filter follows too slowly, or errors of the "
            "measurements last longer than it models."
        )
    return f"Innovations of {source} alternate: the filter follows the noise of its measurements."


def _interval(ends: Sequence[float | None] | None) -> str:
    return number(None) if ends is None else f"{number(ends[0])} to {number(ends[1])}"


def _shares(ends: Sequence[float] | None) -> str:
    return number(None) if ends is None else " to ".join(map(_percent, ends))


def _percent(share: float | None) -> str:
    return number(None) if share is None else f"{100.0 * share:.1f}\N{NO-BREAK SPACE}%"
