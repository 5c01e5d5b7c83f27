"""Draws docs/images/overview.png, the picture of the README, from a campaign folder:

python docs/images/make_overview.py out/inspection [RUN_ID]
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rpojax import Campaign
from rpojax.report.figures.colours import BLUE, GREEN, GRID, INK, MUTED, ORANGE, SHADE, VERMILLION
from rpojax.report.page.run_selection import choose_run

AXES = ("x radial", "y along-track", "z normal")
BANDS = {1.0: "#dbe9f3", 5.0: "#accfe5", 25.0: "#79b3d6"}
AWAY = (1, 2, 3)  # guidance modes: turn, burn, turn back


def draw(campaign: Campaign, run_id: int | None) -> Figure:
    """The picture: all runs on the left, one run on the right."""
    figure = Figure(figsize=(12.0, 5.0), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    figure.get_layout_engine().set(w_pad=0.06, h_pad=0.03, wspace=0.02, hspace=0.03)  # pyright: ignore[reportOptionalMemberAccess]
    grid = figure.add_gridspec(3, 3, width_ratios=(1.15, 1.0, 1.0))
    _formation_error(figure.add_subplot(grid[:, 0]), campaign)
    shown = choose_run(campaign, run_id)
    if shown is None:
        raise SystemExit("the campaign keeps no full history of a run")
    history = campaign.history(shown)
    for axis in range(3):
        position, error = figure.add_subplot(grid[axis, 1]), figure.add_subplot(grid[axis, 2])
        _relative_position(position, history, axis)
        _estimation_error(error, history, axis)
        if axis == 0:
            position.set_title(f"Run {shown}: servicer from target [m]", fontsize=10, color=INK)
            error.set_title(f"Run {shown}: error of the estimate [m]", fontsize=10, color=INK)
    figure.align_ylabels()
    return figure


def _formation_error(axes: Axes, campaign: Campaign) -> None:
    error, time_s = campaign.traces["formation_error_m"], campaign.trace_time_s
    for share, color in BANDS.items():
        low, high = np.nanpercentile(error, (share, 100.0 - share), axis=0)
        label = f"{share:g} to {100.0 - share:g} % of the runs"
        axes.fill_between(time_s, low, high, color=color, lw=0.0, label=label)
    axes.plot(time_s, np.nanmedian(error, axis=0), color=BLUE, lw=1.8, label="median")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_title(f"Formation error of {len(error)} dispersed runs [m]", fontsize=10, color=INK)
    axes.legend(fontsize=8, frameon=False, loc="upper right")
    _finish(axes, time_s, last=True)


def _relative_position(axes: Axes, history: dict[str, np.ndarray], axis: int) -> None:
    axes.plot(history["time_s"], history["rho_H"][:, axis], color=ORANGE, lw=2.0, label="truth")
    axes.plot(history["time_s"], history["rho_estimate_H"][:, axis], color=BLUE, lw=0.9, label="estimate")
    axes.axhline(history["rho_desired_H"][axis], color=GREEN, lw=1.2, ls=(0, (5, 2)), label="desired")
    if axis == 1:
        axes.legend(fontsize=7.5, frameon=False, loc="lower right", ncols=3, columnspacing=1.2, handlelength=1.6)
    _one_run(axes, history, axis)


def _estimation_error(axes: Axes, history: dict[str, np.ndarray], axis: int) -> None:
    time_s, bound = history["time_s"], 3.0 * history["relative_sigma_H"][:, axis]
    axes.fill_between(time_s, -bound, bound, color=VERMILLION, alpha=0.1, lw=0.0)
    axes.plot(time_s, bound, color=VERMILLION, lw=0.8, label="3 sigma")
    axes.plot(time_s, -bound, color=VERMILLION, lw=0.8)
    error = history["rho_estimate_H"][:, axis] - history["rho_H"][:, axis]
    axes.plot(time_s, error, color=BLUE, lw=0.9, label="error")
    settled = 1.25 * float(np.nanmax(bound[len(bound) // 10 :]))  # the hand-over is off scale
    axes.set_ylim(-settled, settled)
    if axis == 1:
        axes.legend(fontsize=7.5, frameon=False, loc="lower right", ncols=2, columnspacing=1.2, handlelength=1.6)
    _one_run(axes, history, axis)


def _one_run(axes: Axes, history: dict[str, np.ndarray], axis: int) -> None:
    away = np.isin(history["mode"], AWAY).tolist()
    across = axes.get_xaxis_transform()
    axes.fill_between(history["time_s"], 0.0, 1.0, where=away, transform=across, color=SHADE, alpha=0.25, lw=0.0)
    axes.set_ylabel(AXES[axis], fontsize=8, color=INK)
    _finish(axes, history["time_s"], last=axis == 2)


def _finish(axes: Axes, time_s: np.ndarray, last: bool) -> None:
    axes.set_xlim(time_s[0], time_s[-1])
    axes.set_xlabel("time [s]" if last else "", fontsize=8, color=INK)
    axes.tick_params(labelsize=8, colors=MUTED, labelbottom=last)
    axes.grid(color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        raise SystemExit(__doc__)
    picture = draw(Campaign(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) == 3 else None)
    picture.savefig(Path(__file__).with_name("overview.png"), dpi=110)
