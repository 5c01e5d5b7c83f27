"""Inspection coverage: shares of the target's surface that were lit and seen, and the parts that were seen least."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.metrics.surface_coverage import SEEN_FRACTION, TIME_TO_90_PERCENT
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.coverage.surface_picture import surface_picture
from rpojax.report.figures.png_export import png_bytes
from rpojax.report.number_format import format_number

FIGURE_NAME: Final = "surface_coverage.png"
_LEAST_SEEN: Final = 10


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
    title = f"Inspection coverage: {campaign.info.get('name', 'campaign')}"
    runs = len(campaign.run_ids)
    lit, seen = _runs_with(campaign, "lit_samples"), _runs_with(campaign, "seen_samples")
    if runs == 1:
        seen, label = campaign.coverage["seen_samples"][0], "samples in which a facet was seen"
        values = np.where(lit > 0, seen, np.nan)
    else:
        label = "seen in this share of the runs with light on it"
        values = np.where(lit > 0, seen / np.maximum(lit, 1), np.nan)
    figure = surface_picture(campaign.surface, values, 1.0 if runs > 1 else max(float(np.max(seen)), 1.0), label, title)
    return write_atomically(campaign.directory / "figures" / FIGURE_NAME, png_bytes(figure))


def _runs_with(campaign: CampaignResults, name: str) -> np.ndarray:
    """For each facet the number of runs with at least one such sample."""
    return np.sum(campaign.coverage[name] > 0, axis=0)
