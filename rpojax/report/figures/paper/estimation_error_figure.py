"""Position estimation errors of one run with 3-sigma bounds (Figure 7 of the paper)."""

import numpy as np
from matplotlib.figure import Figure

from rpojax.report.figures.colours import BLUE, INK, VERMILLION
from rpojax.report.figures.paper.history_axes import History, add_legend, new_figure, style_axes
from rpojax.report.figures.png_export import AXIS_NAMES


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
