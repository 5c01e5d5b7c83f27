"""Picture of a study of robustness: margins of quantities as bars, in believed sigmas."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rpojax.report.figures import png_export
from rpojax.report.figures.colours import BLUE, GRID, INK, MUTED, SHADE
from rpojax.report.robust_margins import MarginRow, SideMargin

_TICKS = (0, 1, 2, 4, 8, 16)
_ROOM = 400.0
"""Where the axis ends, on its logarithmic scale: beside the bars there are labels."""


def margin_bars(name: str, rows: Sequence[MarginRow]) -> bytes:
    """PNG file of the margins of a scenario with a `name`."""
    figure = Figure(figsize=(11.0, 1.4 + 0.5 * len(rows)), layout="constrained", facecolor="white")
    figure.suptitle(
        f"{name}: how far each quantity may be off", x=0.01, ha="left", fontsize=11, color=INK, parse_math=False
    )
    axes = figure.subplots()
    for place, row in enumerate(rows):
        _bar(axes, place, row.low, -1.0, "" if row.is_any else _label(row.low))
        _bar(axes, place, row.high, 1.0, _label(row.high) + (", in any direction" if row.is_any else ""))
    axes.set_xscale("symlog", linthresh=1.0)
    axes.set_xlim(-_ROOM, _ROOM)
    ticks = [-tick for tick in reversed(_TICKS[1:])] + list(_TICKS)
    axes.set_xticks(ticks, [f"{abs(tick)}" for tick in ticks])
    axes.set_xticks([], minor=True)
    axes.set_yticks(range(len(rows)), [row.title for row in rows])
    axes.invert_yaxis()
    axes.axvline(0.0, color=INK, lw=1.0)
    axes.set_xlabel("below nominal      margin [believed sigmas]      above nominal", fontsize=9, color=INK)
    axes.tick_params(labelsize=9, colors=MUTED)
    axes.grid(axis="x", color=GRID, lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    return png_export.png_bytes(figure)


def _label(side: SideMargin) -> str:
    return "holds" if side.requirement is None else side.requirement


def _bar(axes: Axes, place: int, side: SideMargin, sign: float, label: str) -> None:
    """A bar to one side, with a text beyond its end; pale where nothing breaks."""
    colour = SHADE if side.requirement is None else BLUE
    axes.barh(place, sign * side.sigmas, height=0.6, color=colour, alpha=0.45 if side.requirement is None else 0.85)
    axes.annotate(
        label,
        (sign * side.sigmas, place),
        (4.0 * sign, 0.0),
        textcoords="offset points",
        va="center",
        ha="left" if sign > 0.0 else "right",
        fontsize=8,
        color=MUTED if side.requirement is None else INK,
    )
