"""Bearing and range measured from the boxes of one run (Figure 6 of the paper)."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rpojax.report.figures.colours import BLUE, INK, MUTED, VERMILLION
from rpojax.report.figures.paper.history_axes import History, add_legend, new_figure, style_axes
from rpojax.report.figures.png_export import AXIS_NAMES


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
