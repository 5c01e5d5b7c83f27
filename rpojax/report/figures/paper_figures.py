"""Figures 6, 7 and 8 of the paper for one run with full history, as PNG files."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.report.figures import png_export
from rpojax.report.figures.colours import BLUE, GREEN, GRID, INK, MUTED, ORANGE, SHADE, VERMILLION
from rpojax.report.figures.png_export import AXIS_NAMES
from rpojax.report.labels import LOOK_AWAY_MODES

History = Mapping[str, np.ndarray]
_HEADINGS = {
    "bearing_and_range.png": "Bearing and range (as Figure 6 of the paper)",
    "estimation_error.png": "Estimation error (as Figure 7 of the paper)",
    "relative_position.png": "Relative position (as Figure 8 of the paper)",
}
_COMMON_CHANNELS = ("time_s", "mode", "rho_H")
REQUIRED_CHANNELS: dict[str, tuple[str, ...]] = {
    "bearing_and_range.png": (*_COMMON_CHANNELS, "box_bearing_H", "box_range_m", "box_present", "box_accepted"),
    "estimation_error.png": (
        *_COMMON_CHANNELS,
        *(f"{name}_{part}_H" for name in ("target", "servicer", "relative") for part in ("error", "sigma")),
    ),
    "relative_position.png": (*_COMMON_CHANNELS, "rho_estimate_H", "rho_desired_H"),
}
"""Channels that each figure shows."""


def new_figure(title: str, size_inches: tuple[float, float]) -> Figure:
    """Empty figure with a title."""
    figure = Figure(figsize=size_inches, layout="constrained", facecolor="white")
    # The title contains the scenario's name, in which a dollar sign does not start a formula.
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold", color=INK, parse_math=False)
    return figure


def style_axes(axes: Axes, history: History, label: str, last: bool) -> None:
    """Sets limits, label and grid of axes over time, and shades look-aways and searches."""
    _shade_intervals(
        axes, history, np.isin(history["mode"], LOOK_AWAY_MODES), SHADE, "look-away (turn, burn, turn back)"
    )
    _shade_intervals(axes, history, history["mode"] == Mode.SEARCH, ORANGE, "search")
    axes.set_xlim(history["time_s"][0], history["time_s"][-1])
    axes.set_ylabel(label, fontsize=9, color=INK)
    axes.set_xlabel("time [s]" if last else "", fontsize=9, color=INK)
    axes.tick_params(labelsize=8, colors=MUTED, labelbottom=last)
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)


def _shade_intervals(axes: Axes, history: History, where: np.ndarray, color: str, label: str) -> None:
    shown = where & np.isfinite(history["rho_H"][:, 0])
    if not np.any(shown):
        return
    held = shown.copy()
    held[1:] |= shown[:-1]  # a sample holds until the next one
    transform, look = axes.get_xaxis_transform(), {"color": color, "alpha": 0.25, "lw": 0.0, "label": label}
    axes.fill_between(history["time_s"], 0.0, 1.0, where=held.tolist(), transform=transform, **look)


def add_legend(figure: Figure, *axes: Axes) -> None:
    """Adds one legend for several axes, each label once."""
    figure.align_ylabels()
    entries: dict[str, Artist] = {}
    for part in axes:
        handles, labels = part.get_legend_handles_labels()
        entries.update(zip(labels, handles, strict=True))
    names = list(entries)
    handles = list(entries.values())
    figure.legend(handles, names, loc="outside lower center", ncols=len(names), fontsize=9, frameon=False)


def bearing_and_range(history: History, title: str) -> Figure:
    """Figure 6: bearing components [-] and coarse range [m] measured from the boxes of one run, with the truth."""
    figure = new_figure(title, (10.8, 5.2))
    grid = figure.add_gridspec(3, 2, width_ratios=(1.15, 1.0))
    bearings = [figure.add_subplot(grid[row, 0]) for row in range(3)]
    distance = figure.add_subplot(grid[:, 1])
    true_range = np.linalg.norm(history["rho_H"], axis=1)
    for axis, axes in enumerate(bearings):
        measured, truth = history["box_bearing_H"][:, axis], -history["rho_H"][:, axis] / true_range
        _plot_boxes(axes, history, measured, truth, _bearing_limits(history, measured, truth))
        style_axes(axes, history, f"{AXIS_NAMES[axis]} [-]", last=axis == 2)
    # Twice the largest true range: false boxes can be far out.
    highest = 2.0 * float(np.max(true_range, initial=1.0, where=np.isfinite(true_range)))
    _plot_boxes(distance, history, history["box_range_m"], true_range, (0.0, highest))
    style_axes(distance, history, "range [m]", last=True)
    bearings[0].set_title("Bearing unit vector, servicer to target, Hill frame", fontsize=10, color=INK, loc="left")
    distance.set_title("Range from the size of the box", fontsize=10, color=INK, loc="left")
    add_legend(figure, *bearings, distance)
    return figure


def _plot_boxes(
    axes: Axes, history: History, measured: np.ndarray, truth: np.ndarray, limits: tuple[float, float]
) -> None:
    """Plots boxes as dots and crosses, those outside `limits` as small triangles at the edge with their count."""
    time, present = history["time_s"], history["box_present"].astype(bool)
    accepted = present & history["box_accepted"].astype(bool)
    inside = (measured >= limits[0]) & (measured <= limits[1])
    kinds = (("accepted", accepted, ".", 2.2, BLUE, 3.0), ("rejected", present & ~accepted, "x", 5.0, VERMILLION, 2.5))
    for name, boxes, marker, size, color, order in kinds:
        drawn = boxes & inside
        look = {"ls": "", "color": color, "zorder": order, "mew": 1.1 if marker == "x" else 0.0}
        axes.plot(time[drawn], measured[drawn], marker=marker, ms=size, label=f"{name} box", **look)
        for edge, off, arrow in ((limits[1], measured > limits[1], "^"), (limits[0], measured < limits[0], "v")):
            if not np.any(boxes & off):
                continue
            beyond = time[boxes & off]
            edges = {**look, "marker": arrow, "ms": 3.0, "mew": 0.0, "clip_on": False, "gid": f"{name} beyond {arrow}"}
            axes.plot(beyond, np.full(len(beyond), edge), **edges)
    axes.plot(time, truth, color=INK, lw=0.7, zorder=3.5, label="truth")
    axes.set_ylim(*limits)
    if count := np.count_nonzero(present & ~inside):
        text = f"beyond the scale: {count}"
        axes.text(1.0, 1.02, text, transform=axes.transAxes, ha="right", va="bottom", fontsize=8, color=MUTED)


def _bearing_limits(history: History, measured: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Range of accepted boxes and truth with a margin; false boxes would make it too wide."""
    accepted = history["box_present"].astype(bool) & history["box_accepted"].astype(bool)
    shown = np.concatenate([measured[accepted], truth])
    shown = shown[np.isfinite(shown)]
    low, high = (float(shown.min()), float(shown.max())) if len(shown) else (-1.0, 1.0)
    margin = max(0.08 * (high - low), 1e-3)
    return low - margin, high + margin


def estimation_error(history: History, title: str) -> Figure:
    """Figure 7: position error [m] of target, servicer and servicer from target per Hill axis, with 3-sigma bounds."""
    figure = new_figure(title, (10.8, 6.2))
    columns = (("target", "Target"), ("servicer", "Servicer"), ("relative", "Relative (servicer from target)"))
    cells = figure.subplots(3, 3, sharex=True)
    for column, (name, heading) in enumerate(columns):
        error, bound = history[f"{name}_error_H"], 3.0 * history[f"{name}_sigma_H"]
        if name == "relative":
            error = -error  # recorded as the error of the target from the servicer
        for axis in range(3):
            axes = cells[axis, column]
            axes.plot(history["time_s"], error[:, axis], color=BLUE, lw=0.9, label="error")
            axes.plot(history["time_s"], bound[:, axis], color=VERMILLION, lw=0.9, label="3-sigma bound")
            axes.plot(history["time_s"], -bound[:, axis], color=VERMILLION, lw=0.9)
            limit = _axis_limit(history["time_s"], error[:, axis], bound[:, axis])
            axes.set_ylim(-limit, limit)
            style_axes(axes, history, f"{AXIS_NAMES[axis]} [m]" if column == 0 else "", last=axis == 2)
        cells[0, column].set_title(heading, fontsize=10, color=INK)
    add_legend(figure, cells[0, 0])
    return figure


def _axis_limit(time_s: np.ndarray, error: np.ndarray, bound: np.ndarray) -> float:
    """Half height [m] of an axis that fits the run after its first tenth; hand-over errors may be off scale."""
    size = np.maximum(np.abs(error), bound)
    settled = size[time_s >= time_s[0] + 0.1 * (time_s[-1] - time_s[0])]
    for candidates in (settled, size):
        finite = candidates[np.isfinite(candidates)]
        if len(finite):
            return 1.15 * float(finite.max()) or 1.0
    return 1.0


def relative_position(history: History, title: str) -> Figure:
    """Figure 8: position [m] of the TARGET from the servicer per Hill axis, the negative of rho used elsewhere."""
    figure = new_figure(title, (10.8, 5.8))
    rows = figure.subplots(3, 1, sharex=True)
    for axis, axes in enumerate(rows):
        axes.plot(history["time_s"], -history["rho_estimate_H"][:, axis], color=BLUE, lw=1.0, label="estimate")
        axes.plot(history["time_s"], -history["rho_H"][:, axis], color=ORANGE, lw=1.6, label="truth")
        desired = np.broadcast_to(history["rho_desired_H"], history["rho_H"].shape)[:, axis]
        axes.plot(history["time_s"], -desired, color=GREEN, lw=1.3, ls=(0, (5, 2)), label="desired")
        axes.lines[0].set_zorder(axes.lines[1].get_zorder() + 0.5)
        style_axes(axes, history, f"{AXIS_NAMES[axis]} [m]", last=axis == 2)
    rows[0].set_title(
        "Target relative to the servicer, Hill frame (sign flipped: elsewhere rho is the servicer from the target)",
        fontsize=10,
        color=INK,
    )
    add_legend(figure, rows[0])
    return figure


FIGURES: dict[str, Callable[[History, str], Figure]] = {
    "bearing_and_range.png": bearing_and_range,
    "estimation_error.png": estimation_error,
    "relative_position.png": relative_position,
}
"""File name -> function that draws the figure from a history and a title."""


def missing_channels(history: History) -> dict[str, list[str]]:
    """File name of each figure that cannot be drawn -> channels that the history lacks."""
    absent = {
        name: [channel for channel in needed if channel not in history] for name, needed in REQUIRED_CHANNELS.items()
    }
    return {name: channels for name, channels in absent.items() if channels}


def write_figures(history: History, directory: Path, title: str) -> dict[str, Path]:
    """Writes the figures whose channels a history contains into `directory` as PNG; returns file name -> path."""
    omitted = missing_channels(history)
    return {
        name: write_atomically(directory / name, png_export.png_bytes(draw(history, f"{_HEADINGS[name]}: {title}")))
        for name, draw in FIGURES.items()
        if name not in omitted
    }
