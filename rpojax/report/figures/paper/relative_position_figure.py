"""Relative position of one run: estimate, truth and desired (Figure 8 of the paper)."""

import numpy as np
from matplotlib.figure import Figure

from rpojax.report.figures.colours import BLUE, GREEN, INK, ORANGE
from rpojax.report.figures.paper.history_axes import History, add_legend, new_figure, style_axes
from rpojax.report.figures.png_export import AXIS_NAMES


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
