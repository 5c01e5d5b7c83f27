"""A team of servicers: outcomes and phases of each, and who of them saw the target."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.report.campaign_results import CampaignResults
from rpojax.report.dispersed_inputs import nominal_keep_out_radii
from rpojax.report.figures.png_export import png_bytes
from rpojax.report.mission import phase_section
from rpojax.report.team.relative_orbits_figure import REQUIRED_CHANNELS, relative_orbits
from rpojax.report.team.servicer_results import of_servicer
from rpojax.simulation.outcomes.outcome_kinds import count_outcomes

FIGURE_NAME: Final = "relative_orbits.png"


def content(campaign: CampaignResults) -> dict[str, Any] | None:
    """Part of report.json; None for one servicer alone.

    Metrics of each servicer are in the part `metrics`, as `NAME/SERVICER`. Shares of ticks with an accepted box are
    means over the runs with a stored history, None without any.
    """
    if not campaign.servicer_names:
        return None
    scenario = campaign.info.get("scenario", {})
    return {
        "servicers": [_servicer_content(campaign, number) for number in range(len(campaign.servicer_names))],
        "sharing": scenario.get("navigation", {}).get("sharing"),
        "link": scenario.get("link"),
        "gps_differences": scenario.get("gps_differences"),
        "boxes": _box_shares(campaign),
    }


def write_figure(campaign: CampaignResults, run_id: int | None) -> Path | None:
    """Writes the picture of the relative orbits of a run; None for one servicer alone and without their positions."""
    if not campaign.servicer_names or run_id is None:
        return None
    history = campaign.history(run_id)
    if any(name not in history for name in REQUIRED_CHANNELS):
        return None
    title = f"Relative orbits: {campaign.info.get('name', 'campaign')}, run {run_id}"
    figure = relative_orbits(history, campaign.servicer_names, nominal_keep_out_radii(campaign), title)
    return write_atomically(campaign.directory / "figures" / FIGURE_NAME, png_bytes(figure))


def _servicer_content(campaign: CampaignResults, number: int) -> dict[str, Any]:
    name, scenario = campaign.servicer_names[number], campaign.info.get("scenario", {})
    own = of_servicer(campaign, number)
    changes = next((each for each in scenario.get("servicers", []) if each.get("name") == name), {})
    fault = {**scenario.get("fault", {}), **(changes.get("fault") or {})}
    return {
        "name": name,
        "outcomes": count_outcomes(own.outcomes),
        "fault": fault if scenario.get("effects", {}).get("faults") else None,
        "mission": phase_section.content(own),
    }


def _box_shares(campaign: CampaignResults) -> dict[str, Any] | None:
    """Shares of the ticks of a run in which each servicer, anybody and everybody accepted a box."""
    accepted = [_accepted_boxes(campaign.history(run)) for run in sorted(campaign.history_ids)]
    accepted = [each for each in accepted if each is not None and len(each)]
    if not accepted:
        return None
    return {
        "runs": len(accepted),
        "of_each": np.mean([each.mean(axis=0) for each in accepted], axis=0).tolist(),
        "of_anybody": float(np.mean([each.any(axis=1).mean() for each in accepted])),
        "of_everybody": float(np.mean([each.all(axis=1).mean() for each in accepted])),
    }


def _accepted_boxes(history: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Flags (ticks, servicers) of accepted boxes of the target, until a run is frozen; None if they were not kept."""
    if not {"box_accepted", "box_outlier", "range_m"} <= set(history):
        return None
    alive = np.isfinite(history["range_m"]).all(axis=1)
    return np.asarray(history["box_accepted"] & ~history["box_outlier"], dtype=bool)[alive]
