"""Picture of the target from its six sides, each facet coloured by a value."""

from collections.abc import Mapping
from typing import Final

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from rpojax.report.figures.colours import INK, MUTED, SHADE

_VIEWS: Final = {
    "+x": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "+y": ((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "+z": ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)),
    "-x": ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    "-y": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "-z": ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
}
"""For the side from which the target is seen, the axes of T that point right and up; opposite sides in one column."""
_WIDTH_INCHES: Final = 8.5
_COLOURS: Final = "viridis"


def surface_picture(
    surface: Mapping[str, np.ndarray], values: np.ndarray, highest: float, label: str, title: str
) -> Figure:
    """Target in parallel projection along the axes of T.

    Args:
        surface: `pieces` (pieces, 3, 3) of facets [m] and `piece_facets` (pieces,)
        values: (facets,) 0 to `highest`, NaN for facets to be shown grey: those that were never lit
        highest: value at the end of the colour scale
        label: what the values are
        title: of the figure
    """
    spans = np.ptp(surface["pieces"].reshape(-1, 3), axis=0)
    widths = [float(np.abs(right) @ spans) for right, _ in list(_VIEWS.values())[:3]]
    height = max(float(np.abs(up) @ spans) for _, up in _VIEWS.values())
    inch_per_m = _WIDTH_INCHES / sum(widths)
    figure = Figure(
        figsize=(_WIDTH_INCHES + 2.5, 2.0 * inch_per_m * height + 1.8), layout="constrained", facecolor="white"
    )
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold", color=INK, parse_math=False)
    scale = ScalarMappable(Normalize(0.0, highest), matplotlib.colormaps[_COLOURS].with_extremes(bad=SHADE))
    colours = scale.to_rgba(np.ma.masked_invalid(values))[surface["piece_facets"]]
    rows = figure.subplots(2, 3, width_ratios=widths)
    for axes, (side, (right, up)) in zip(rows.flat, _VIEWS.items(), strict=True):
        _draw_view(axes, surface["pieces"], colours, np.array(right), np.array(up))
        axes.set_title(f"from {side}", fontsize=9, color=INK)
    figure.colorbar(scale, ax=rows, shrink=0.9, label=f"{label}\n(grey: never lit)").ax.tick_params(labelsize=8)
    return figure


def _draw_view(axes: Axes, pieces: np.ndarray, colours: np.ndarray, right: np.ndarray, up: np.ndarray) -> None:
    """Draws the pieces that face the viewer, the farthest first."""
    towards = np.cross(right, up)
    normals = np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])
    facing = np.flatnonzero(normals @ towards > 0.0)
    order = facing[np.argsort(pieces[facing].mean(axis=1) @ towards, kind="stable")]
    flat = pieces @ np.stack([right, up], axis=1)
    shown = colours[order]
    axes.add_collection(PolyCollection(list(flat[order]), facecolors=shown, edgecolors=shown, linewidths=0.3))
    low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.tick_params(labelsize=7, colors=MUTED)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)
    for set_label, axis in ((axes.set_xlabel, right), (axes.set_ylabel, up)):
        letter = "xyz"[int(np.argmax(np.abs(axis)))]
        set_label(f"{'-' if axis.sum() < 0.0 else ''}{letter} [m]", fontsize=8, color=MUTED)
