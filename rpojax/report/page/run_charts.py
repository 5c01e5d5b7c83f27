"""Charts of one run over time: position, estimation errors with bounds, burns, wheels, pointing, and camera boxes."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from rpojax.report.figures.colours import BLUE, GREEN, INK, ORANGE, PURPLE, SHADE, VERMILLION
from rpojax.report.figures.plotly_charts import (
    Chart,
    band_traces,
    channel_line,
    chart_layout,
    limit_line,
    rounded_values,
    time_layout,
)
from rpojax.report.figures.png_export import AXIS_NAMES
from rpojax.report.figures.requirement_limits import Limit
from rpojax.report.labels import LOOK_AWAY_MODES, ChannelLabel, heading
from rpojax.report.page import run_series
from rpojax.report.page.run_series import History, thinned_peaks, thinned_time

_BAND: Final = "rgba(0, 158, 115, 0.2)"
_AXIS_COLOURS: Final = (BLUE, ORANGE, PURPLE)
_MAX_BOXES: Final = 700


def run_charts(history: History, limits: Mapping[str, Sequence[Limit]]) -> dict[str, tuple[str, Chart]]:
    """Name -> title and chart of every series whose channels the history has; `limits` are limits by channel."""
    found: dict[str, tuple[str, Chart]] = {}
    away = _away_shapes(history)
    for label, needed, values in run_series.SERIES:
        if all(name in history for name in needed):
            found[label.name] = (
                heading(label),
                _series_chart(label, history, values(history), limits.get(label.name, []), away),
            )
    found |= {f"error-{name}": chart for name, chart in _error_charts(history, away).items()}
    if "wheel_speed_fraction" in history:
        found["wheel_speed_fraction"] = ("Wheel speeds over their limit", _wheel_chart(history, limits, away))
    return found


def camera_charts(history: History, image_px: tuple[int, int] | None) -> dict[str, tuple[str, Chart]]:
    """Title and chart by name of the boxes: range from their size, place in the image, and side over time."""
    found: dict[str, tuple[str, Chart]] = {}
    if {"box_range_m", "box_present", "box_accepted", "range_m"} <= history.keys():
        found["box-range"] = ("Range from the size of the box [m]", _box_range_chart(history))
    if {"box_px", "box_present", "box_accepted"} <= history.keys():
        found["box-place"] = ("Centre of the box in the image [px]", _box_place_chart(history, image_px))
    if {"box_px", "outline_px", "box_accepted"} <= history.keys():
        found["box-side"] = ("Longer side of the box [px]", _box_side_chart(history))
    return found


def _series_chart(
    label: ChannelLabel, history: History, values: np.ndarray, limits: Sequence[Limit], away: list[dict[str, Any]]
) -> Chart:
    time = thinned_time(history["time_s"])
    traces = [channel_line(label, time, thinned_peaks(values, label.low_is_bad), label.title, BLUE, 1.6)]
    if label.name == "nav_relative_error_m" and "relative_sigma_H" in history:
        bound = thinned_peaks(run_series.relative_bound(history), True)
        traces.append(channel_line(label, time, bound, "3 sigma of the filter", GREEN, 1.4, "dash"))
    return _with_shapes({"data": traces, "layout": time_layout(label, traces)}, limits, away)


def _error_charts(history: History, away: list[dict[str, Any]]) -> dict[str, tuple[str, Chart]]:
    """Errors of the relative and of the servicer's position per Hill axis with 3-sigma bounds."""
    found: dict[str, tuple[str, Chart]] = {}
    for part, words in (("relative", "Relative position"), ("servicer", "Position of the servicer")):
        names = f"{part}_error_H", f"{part}_sigma_H"
        if not set(names) <= history.keys():
            continue
        for axis, axis_name in enumerate(AXIS_NAMES):
            label = ChannelLabel(f"{part}-{axis}", f"{words}, estimation error, {axis_name}", "m")
            error, sigma = (np.asarray(history[name], dtype=np.float64)[:, axis] for name in names)
            found[label.name] = (f"{label.title} [m]", _error_chart(label, history, error, 3.0 * sigma, away))
    return found


def _error_chart(
    label: ChannelLabel, history: History, error: np.ndarray, bound: np.ndarray, away: list[dict[str, Any]]
) -> Chart:
    """Error with its bound; the axis fits what comes after the first tenth of the run."""
    time = thinned_time(history["time_s"])
    signed = _signed_peaks(error)
    width = rounded_values(thinned_peaks(bound, True))
    below = [None if value is None else -value for value in width]
    traces = band_traces(time, below, width, "3 sigma of the filter", _BAND)
    traces.append(channel_line(label, time, signed, "error", BLUE, 1.4))
    layout = time_layout(label, traces)
    settled = slice(len(time) // 10, None)
    shown = np.concatenate([signed[settled], thinned_peaks(bound, True)[settled]])
    if np.isfinite(shown).any():
        reach = 1.2 * float(np.nanmax(np.abs(shown)))
        layout["yaxis"] = {**layout["yaxis"], "range": [-reach, reach]} if reach > 0.0 else layout["yaxis"]
    return _with_shapes({"data": traces, "layout": layout}, [], away)


def _wheel_chart(history: History, limits: Mapping[str, Sequence[Limit]], away: list[dict[str, Any]]) -> Chart:
    label = ChannelLabel("wheel_speed_fraction", "Wheel", "")
    time, speeds = thinned_time(history["time_s"]), np.asarray(history["wheel_speed_fraction"], dtype=np.float64)
    traces = []
    for wheel, colour in enumerate(_AXIS_COLOURS[: speeds.shape[1]]):
        traces.append(channel_line(label, time, _signed_peaks(speeds[:, wheel]), f"wheel {wheel + 1}", colour, 1.4))
    return _with_shapes(
        {"data": traces, "layout": time_layout(label, traces)}, limits.get("wheel_speed_fraction", []), away
    )


def _box_range_chart(history: History) -> Chart:
    label = ChannelLabel("box_range_m", "Range", "m", logarithmic=True)
    accepted, rejected = _boxes(history)
    values = np.asarray(history["box_range_m"], dtype=np.float64)
    values, hover = np.where(values > 0.0, values, np.nan), "NAME: %{y:.4g} at %{x} s"
    traces = [
        _points(history["time_s"][rejected], values[rejected], accepted=False, opacity=0.7, hover=hover),
        _points(history["time_s"][accepted], values[accepted], accepted=True, opacity=0.7, hover=hover),
        channel_line(
            label, thinned_time(history["time_s"]), thinned_peaks(history["range_m"], True), "true range", INK, 1.4
        ),
    ]
    return {"data": traces, "layout": time_layout(label, traces)}


def _box_place_chart(history: History, image_px: tuple[int, int] | None) -> Chart:
    accepted, rejected = _boxes(history)
    box = np.asarray(history["box_px"], dtype=np.float64)
    centre = box[:, :2] + 0.5 * box[:, 2:]
    traces = [
        _points(*centre[rows].T, accepted=good, opacity=0.6, hover="%{x}, %{y} px")
        for rows, good in ((rejected, False), (accepted, True))
    ]
    layout = chart_layout("to the right [px]", "downwards [px]")
    if image_px is not None:
        width, height = image_px
        layout["xaxis"] |= {"range": [0, width]}
        layout["yaxis"] |= {"range": [height, 0]}
    return {"data": traces, "layout": layout}


def _box_side_chart(history: History) -> Chart:
    label = ChannelLabel("box_side_px", "Longer side", "px", logarithmic=True)
    time, accepted = thinned_time(history["time_s"]), np.asarray(history["box_accepted"], dtype=bool)
    box = np.asarray(history["box_px"], dtype=np.float64)[:, 2:].max(axis=1)
    outline = np.asarray(history["outline_px"], dtype=np.float64)[:, 2:].max(axis=1)
    traces = [
        channel_line(label, time, thinned_peaks(np.where(accepted, box, np.nan), False), "accepted box", GREEN, 1.4),
        channel_line(label, time, thinned_peaks(outline, False), "true outline", INK, 1.2, "dash"),
    ]
    return {"data": traces, "layout": time_layout(label, traces)}


def _boxes(history: History) -> tuple[np.ndarray, np.ndarray]:
    """Ticks with an accepted and with a rejected box, at most `_MAX_BOXES` of each."""
    accepted = np.asarray(history["box_accepted"], dtype=bool)
    present = np.asarray(history["box_present"], dtype=bool)
    ticks = np.flatnonzero(accepted), np.flatnonzero(present & ~accepted)
    first, second = (found[:: max(1, -(-len(found) // _MAX_BOXES))] for found in ticks)
    return first, second


def _points(x: np.ndarray, y: np.ndarray, *, accepted: bool, opacity: float, hover: str) -> dict[str, Any]:
    """Points of accepted or of rejected boxes."""
    name, colour = ("accepted boxes", GREEN) if accepted else ("rejected boxes", VERMILLION)
    return {
        "type": "scatter",
        "mode": "markers",
        "x": rounded_values(x),
        "y": rounded_values(y),
        "name": name,
        "marker": {"size": 3.5, "color": colour, "opacity": opacity},
        "hovertemplate": hover.replace("NAME", name),
    }


def _signed_peaks(values: np.ndarray) -> np.ndarray:
    """Thinned values of greatest size, with their signs."""
    largest, least = thinned_peaks(values, False), thinned_peaks(values, True)
    return np.where(np.abs(largest) >= np.abs(least), largest, least)


def _away_shapes(history: History) -> list[dict[str, Any]]:
    """Shaded spans in which the camera is turned away for a burn."""
    if "mode" not in history:
        return []
    away = np.isin(history["mode"], LOOK_AWAY_MODES).astype(int)
    edges = np.flatnonzero(np.diff(away, prepend=0, append=0))
    time = np.append(history["time_s"], history["time_s"][-1])
    return [
        {
            "type": "rect",
            "xref": "x",
            "yref": "paper",
            "y0": 0,
            "y1": 1,
            "opacity": 0.18,
            "fillcolor": SHADE,
            "x0": float(time[begin]),
            "x1": float(time[end]),
            "line": {"width": 0},
        }
        for begin, end in zip(edges[::2], edges[1::2], strict=True)
    ]


def _with_shapes(chart: Chart, limits: Sequence[Limit], away: list[dict[str, Any]]) -> Chart:
    shapes = [*away, *(limit_line(limit.value, limit.channel_text) for limit in limits)]
    return {**chart, "layout": {**chart["layout"], "shapes": shapes}}
