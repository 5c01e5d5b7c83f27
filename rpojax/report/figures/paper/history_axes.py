"""Axes that show a run's history over time: limits, grid, shaded look-aways and searches, shared legend."""

from collections.abc import Mapping

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.report.figures.colours import GRID, INK, MUTED, ORANGE, SHADE

History = Mapping[str, np.ndarray]
_LOOK_AWAY_MODES = (Mode.TURN, Mode.BURN, Mode.TURN_BACK)


def new_figure(title: str, size_inches: tuple[float, float]) -> Figure:
    """Empty figure with a title."""
    figure = Figure(figsize=size_inches, layout="constrained", facecolor="white")
    # The title contains the scenario's name, in which a dollar sign does not start a formula.
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold", color=INK, parse_math=False)
    return figure


def style_axes(axes: Axes, history: History, label: str, last: bool) -> None:
    """Sets limits, label and grid of axes over time, and shades look-aways and searches."""
    _shade_intervals(
        axes, history, np.isin(history["mode"], _LOOK_AWAY_MODES), SHADE, "look-away (turn, burn, turn back)"
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
