"""Relative orbits of the servicers of one run about the target, in the Hill frame."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from rpojax.report.figures.colours import (
    BLUE,
    GREEN,
    GRID,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILLION,
    YELLOW,
)
from rpojax.report.figures.paper.history_axes import new_figure
from rpojax.report.figures.png_export import AXIS_NAMES

REQUIRED_CHANNELS: Final = ("rho_H",)
_COLOURS: Final = (BLUE, ORANGE, GREEN, PURPLE, VERMILLION, SKY_BLUE, YELLOW, INK)
_WIDTH_INCHES: Final = 10.8
_ALONG, _ACROSS, _RADIAL = 1, 2, 0


def relative_orbits(
    history: Mapping[str, np.ndarray], names: Sequence[str], keep_out_m: Sequence[float], title: str
) -> Figure:
    """Along-track over radial and cross-track over radial position of all servicers, target in the middle.

    Args:
        history: of a team's run, `rho_H` (ticks, servicers, 3) the servicer from the target [m]
        names: of the servicers
        keep_out_m: radii of the keep-out spheres [m]
        title: of the figure
    """
    reach = _reach(history["rho_H"], keep_out_m)
    widths = [float(reach[across]) for across in (_ALONG, _ACROSS)]
    height = float(np.clip(1.5 + 0.9 * _WIDTH_INCHES * reach[_RADIAL] / sum(widths), 3.0, 9.0))
    figure = new_figure(title, (_WIDTH_INCHES, height))
    planes = figure.subplots(1, 2, width_ratios=widths)
    for axes, across in zip(planes, (_ALONG, _ACROSS), strict=True):
        for number, name in enumerate(names):
            _plot_orbit(axes, history["rho_H"][:, number], across, name, _COLOURS[number % len(_COLOURS)])
        axes.plot(0.0, 0.0, marker="+", ms=9, mew=1.4, ls="", color=INK, label="target")
        for number, radius in enumerate(keep_out_m):
            label = "" if number else "keep-out"
            axes.add_patch(Circle((0.0, 0.0), radius, fill=False, ls="--", lw=1.0, ec=MUTED, label=label))
        _style(axes, across, reach)
    planes[0].set_ylabel(f"{AXIS_NAMES[_RADIAL]} [m]", fontsize=9, color=INK)
    handles, labels = planes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9, frameon=False)
    return figure


def _plot_orbit(axes: Axes, rho_H: np.ndarray, across: int, name: str, colour: str) -> None:
    """Path of a servicer, with a dot where it begins and a square where it ends."""
    path = rho_H[np.isfinite(rho_H).all(axis=1)]
    axes.plot(path[:, across], path[:, _RADIAL], color=colour, lw=1.1, label=name)
    for marker, point in (("o", path[:1]), ("s", path[-1:])):
        axes.plot(point[:, across], point[:, _RADIAL], marker=marker, ms=6, ls="", color=colour, mec="white", mew=0.8)


def _reach(rho_H: np.ndarray, keep_out_m: Sequence[float]) -> np.ndarray:
    """Half the extent of the figure along each Hill axis (3,) [m], with a margin around all that is drawn."""
    greatest = np.max(np.abs(rho_H), axis=(0, 1), where=np.isfinite(rho_H), initial=1.0)
    return 1.08 * np.maximum(greatest, max(keep_out_m, default=0.0))


def _style(axes: Axes, across: int, reach: np.ndarray) -> None:
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(-reach[across], reach[across])
    axes.set_ylim(-reach[_RADIAL], reach[_RADIAL])
    axes.set_xlabel(f"{AXIS_NAMES[across]} [m]", fontsize=9, color=INK)
    axes.tick_params(labelsize=8, colors=MUTED)
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)
