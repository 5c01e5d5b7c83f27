"""Inspection coverage: shares of the target's surface that were lit and seen, and the parts that were seen least."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.metrics.surface_coverage import SEEN_FRACTION, TIME_TO_90_PERCENT
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.figures.colours import DARK_GROUND, DARK_INK, DARK_MUTED, INK, MUTED, SHADE
from rpojax.report.figures.png_export import png_bytes
from rpojax.report.labels import format_number

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
FIGURE_NAME: Final = "surface_coverage.png"
_LEAST_SEEN: Final = 10


def surface_picture(
    surface: Mapping[str, np.ndarray], values: np.ndarray, highest: float, label: str, title: str, dark: bool = False
) -> Figure:
    """Target in parallel projection along the axes of T.

    Args:
        surface: `pieces` (pieces, 3, 3) of facets [m] and `piece_facets` (pieces,)
        values: (facets,) 0 to `highest`, NaN for facets to be shown grey: those that were never lit
        highest: value at the end of the colour scale
        label: what the values are
        title: of the figure
        dark: light letters on dark ground
    """
    ground, ink, muted = (DARK_GROUND, DARK_INK, DARK_MUTED) if dark else ("white", INK, MUTED)
    spans = np.ptp(surface["pieces"].reshape(-1, 3), axis=0)
    widths = [float(np.abs(right) @ spans) for right, _ in list(_VIEWS.values())[:3]]
    height = max(float(np.abs(up) @ spans) for _, up in _VIEWS.values())
    inch_per_m = _WIDTH_INCHES / sum(widths)
    figure = Figure(
        figsize=(_WIDTH_INCHES + 2.5, 2.0 * inch_per_m * height + 1.8), layout="constrained", facecolor=ground
    )
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold", color=ink, parse_math=False)
    scale = ScalarMappable(Normalize(0.0, highest), matplotlib.colormaps[_COLOURS].with_extremes(bad=SHADE))
    colours = scale.to_rgba(np.ma.masked_invalid(values))[surface["piece_facets"]]
    rows = figure.subplots(2, 3, width_ratios=widths)
    for axes, (side, (right, up)) in zip(rows.flat, _VIEWS.items(), strict=True):
        axes.set_facecolor(ground)
        _draw_view(axes, surface["pieces"], colours, np.array(right), np.array(up), muted)
        axes.set_title(f"from {side}", fontsize=9, color=ink)
    bar = figure.colorbar(scale, ax=rows, shrink=0.9)
    bar.set_label(f"{label}\n(grey: never lit)", color=ink)
    bar.ax.tick_params(labelsize=8, colors=muted)
    return figure


def _draw_view(
    axes: Axes, pieces: np.ndarray, colours: np.ndarray, right: np.ndarray, up: np.ndarray, muted: str
) -> None:
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
    axes.tick_params(labelsize=7, colors=muted)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(muted)
    for set_label, axis in ((axes.set_xlabel, right), (axes.set_ylabel, up)):
        letter = "xyz"[int(np.argmax(np.abs(axis)))]
        set_label(f"{'-' if axis.sum() < 0.0 else ''}{letter} [m]", fontsize=8, color=muted)


def content(campaign: CampaignResults) -> dict[str, Any] | None:
    """Part of report.json; None without coverage.

    Shares of facets are of the runs in which a facet was lit; of the ten facets that were seen in the smallest shares
    of them, the first in area are listed first among equals.
    """
    if not campaign.coverage:
        return None
    areas = campaign.surface["areas"]
    lit_runs, seen_runs = _runs_with(campaign, "lit_samples"), _runs_with(campaign, "seen_samples")
    lit = np.flatnonzero(lit_runs > 0)
    share = seen_runs[lit] / lit_runs[lit]
    least = np.lexsort((-areas[lit], share))[:_LEAST_SEEN]
    return {
        "facets": len(areas),
        "area_m2": float(areas.sum()),
        "lit_in_no_run": float(areas[lit_runs == 0].sum() / areas.sum()),
        "lit_but_seen_in_no_run": float(areas[(lit_runs > 0) & (seen_runs == 0)].sum() / areas.sum()),
        "least_seen": [
            {
                "center_m": campaign.surface["centers"][lit[row]].tolist(),
                "normal": campaign.surface["normals"][lit[row]].tolist(),
                "area_m2": float(areas[lit[row]]),
                "lit_runs": int(lit_runs[lit[row]]),
                "seen_runs": int(seen_runs[lit[row]]),
            }
            for row in least
        ],
    }


def rows(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Quantities and values of the page's table."""
    found, metrics = content["coverage"], content["metrics"]
    if found is None:
        return []
    lines = [("Facets", f"{found['facets']} of {format_number(found['area_m2'])} m² in all")]
    for name, title, unit in (
        (SEEN_FRACTION, "Seen area over lit area", ""),
        (TIME_TO_90_PERCENT, "Time to see 90 % of it", " s"),
    ):
        entry = metrics[name]
        if entry["defined"]:
            low, middle, high = (format_number(entry[key]) for key in ("min", "p50", "max"))
            lines.append((title, f"{middle}{unit} in the median run, {low} to {high}, in {entry['defined']} runs"))
    lines.append(("Area that was lit in no run", f"{100.0 * found['lit_in_no_run']:.3g} %"))
    lines.append(("Area that was lit, but seen in no run", f"{100.0 * found['lit_but_seen_in_no_run']:.3g} %"))
    return lines


def write_figure(campaign: CampaignResults) -> Path | None:
    """Writes the picture of the target into the campaign's folder; None without coverage."""
    if not campaign.coverage:
        return None
    return write_atomically(campaign.directory / "figures" / FIGURE_NAME, png_bytes(_picture(campaign)))


def dark_picture(campaign: CampaignResults) -> bytes | None:
    """The same picture for a page in the dark scheme, as a PNG file; None without coverage."""
    return png_bytes(_picture(campaign, dark=True)) if campaign.coverage else None


def _picture(campaign: CampaignResults, dark: bool = False) -> Figure:
    title = f"Inspection coverage: {campaign.info.get('name', 'campaign')}"
    runs = len(campaign.run_ids)
    lit, seen = _runs_with(campaign, "lit_samples"), _runs_with(campaign, "seen_samples")
    if runs == 1:
        seen, label = campaign.coverage["seen_samples"][0], "samples in which a facet was seen"
        values = np.where(lit > 0, seen, np.nan)
    else:
        label = "seen in this share of the runs with light on it"
        values = np.where(lit > 0, seen / np.maximum(lit, 1), np.nan)
    highest = 1.0 if runs > 1 else max(float(np.max(seen)), 1.0)
    return surface_picture(campaign.surface, values, highest, label, title, dark)


def _runs_with(campaign: CampaignResults, name: str) -> np.ndarray:
    """Number of runs with at least one sample, for each facet."""
    return np.sum(campaign.coverage[name] > 0, axis=0)
