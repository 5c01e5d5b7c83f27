"""Where the runs are before the docking port as the last phase begins, seen along the port's axis."""

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.colours import BLUE, GREEN, VERMILLION
from rpojax.report.figures.plotly_charts import Chart, chart_layout, line_trace, rounded_values
from rpojax.report.figures.requirement_limits import limits_of_metrics
from rpojax.report.labels import format_number

_METRIC: Final = "capture_lateral_m"
_PLACES: Final = "arrival_place_P_m"
_SHARE: Final = 0.99
_SIGMAS: Final = math.sqrt(-2.0 * math.log(1.0 - _SHARE))
"""Half axes of the ellipse that holds that share of a normal distribution in the plane, in standard deviations."""
_LEAST_RUNS: Final = 10
_POINTS: Final = 121
_ROOM: Final = 1.1


def content(campaign: CampaignResults) -> dict[str, Any] | None:
    """Part of report.json; None for missions that do not end at a port, and for results of older versions.

    The ellipse is that of 99 % of a normal distribution with mean and covariance of the runs; None of less than ten.
    """
    places = _places(campaign)
    if places is None:
        return None
    limits = limits_of_metrics(campaign.info.get("scenario", {}).get("requirements") or []).get(_METRIC, [])
    limit = min((each.value for each in limits if each.at_most), default=None)
    there = np.isfinite(places).all(axis=1)
    offsets = np.hypot(places[there, 0], places[there, 1])
    return {
        "runs": len(places),
        "arrived": int(there.sum()),
        "limit_m": limit,
        "beyond": None if limit is None else int(np.sum(offsets > limit)),
        "along_median_m": float(np.median(places[there, 2])) if there.any() else None,
        "ellipse": _ellipse(places[there, :2]),
    }


def _places(campaign: CampaignResults) -> np.ndarray | None:
    """(runs, 3) places in P [m], NaN for runs that never came there."""
    found = campaign.phases.get(_PLACES)
    return None if found is None or campaign.servicer_names else np.asarray(found, dtype=float)


def _ellipse(places: np.ndarray) -> dict[str, Any] | None:
    if len(places) < _LEAST_RUNS:
        return None
    variances, axes = np.linalg.eigh(np.cov(places.T))
    return {
        "middle_m": places.mean(axis=0).tolist(),
        "semi_axes_m": (_SIGMAS * np.sqrt(np.maximum(variances[::-1], 0.0))).tolist(),
        "first_axis": axes[:, 1].tolist(),
    }


def chart(campaign: CampaignResults, found: Mapping[str, Any]) -> Chart | None:
    """Points of all runs, those of failed ones marked, with the limit and the ellipse; None if no run came there."""
    places = _places(campaign)
    if places is None or not found["arrived"]:
        return None
    traces = []
    if found["limit_m"] is not None:
        circle = found["limit_m"] * _circle()
        traces.append(_outline(circle, f"limit of {found['limit_m']:g} m", VERMILLION, "dash"))
    if found["ellipse"] is not None:
        middle, first = (np.array(found["ellipse"][name]) for name in ("middle_m", "first_axis"))
        axes = np.array([first, [-first[1], first[0]]])
        points = middle + _circle() * found["ellipse"]["semi_axes_m"] @ axes
        traces.append(_outline(points, "ellipse of 99 %", GREEN, "solid"))
    failed, there = np.asarray(campaign.failed, dtype=bool), np.isfinite(places).all(axis=1)
    for rows, name, colour in ((there & ~failed, "runs", BLUE), (there & failed, "failed runs", VERMILLION)):
        if rows.any():
            traces.append(_points(places[rows], campaign.run_ids[rows], name, colour))
    reach = _ROOM * max(abs(value) for trace in traces for axis in "xy" for value in trace[axis] if value is not None)
    layout = chart_layout("x of the port [m]", "y of the port [m]")
    for axis in ("xaxis", "yaxis"):
        layout[axis]["range"] = [-reach, reach]
    # One metre is as long on both axes.
    layout["yaxis"]["scaleanchor"] = "x"
    return {"data": traces, "layout": layout}


def _circle() -> np.ndarray:
    angles = np.linspace(0.0, 2.0 * np.pi, _POINTS)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _outline(points: np.ndarray, name: str, colour: str, dash: str) -> dict[str, Any]:
    line = line_trace(rounded_values(points[:, 0]), rounded_values(points[:, 1]), name, colour, 1.6, dash)
    return {**line, "hoverinfo": "skip"}


def _points(places: np.ndarray, run_ids: np.ndarray, name: str, colour: str) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": rounded_values(places[:, 0]),
        "y": rounded_values(places[:, 1]),
        "text": run_ids.tolist(),
        "name": name,
        "marker": {"size": 6, "color": colour, "opacity": 0.75},
        "hovertemplate": "run %{text}: %{x:.3g} m, %{y:.3g} m<extra></extra>",
    }


def finding(found: Mapping[str, Any] | None) -> str:
    """What the figure shows in one sentence, empty without one."""
    if found is None:
        return ""
    parts = [f"{found['arrived']} of {found['runs']} runs came there"]
    if found["limit_m"] is not None:
        parts.append(f"{found['beyond']} of them beyond {found['limit_m']:g} m from the axis")
    if found["ellipse"] is not None:
        longer, shorter = (format_number(each, 2) for each in found["ellipse"]["semi_axes_m"])
        parts.append(f"the ellipse of 99 % reaches {longer} m by {shorter} m from its middle")
    return "; ".join(parts)
