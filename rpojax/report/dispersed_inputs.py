"""Dispersed quantities of a campaign as named scalars."""

import numpy as np

from rpojax.report.campaign_results import CampaignResults
from rpojax.scenario.dispersed_numbers.run_values import values_of_runs
from rpojax.scenario.parameter_keys import component_columns

_CATEGORICAL_KEYS = ("fault.kind", "fault.wheel")
"""Keys whose numbers are codes without an order; those of a servicer of a team have its name at the end."""


def dispersed_scalars(campaign: CampaignResults) -> dict[str, np.ndarray]:
    """Every dispersed scalar (runs,); a vector has one entry per component, named `key[0]`, `key[1]`, ..."""
    return component_columns({key: np.asarray(values, dtype=np.float64) for key, values in campaign.drawn.items()})


def keep_out_radii(campaign: CampaignResults) -> np.ndarray | None:
    """Radius of every run's keep-out sphere [m], (runs,), or (1,) where all have the same; None without one.

    Of a team (..., servicers): each servicer keeps out of a sphere of its own.
    """
    each = [
        values_of_runs(campaign.drawn, f"limits.keep_out_m{end}", radius) for end, radius in _nominal_radii(campaign)
    ]
    if not each or not all(radii.size for radii in each):
        return None
    return np.stack(np.broadcast_arrays(*each), axis=-1) if campaign.servicer_names else each[0]


def nominal_keep_out_radii(campaign: CampaignResults) -> list[float]:
    """Radii of the keep-out spheres of the servicers in the scenario [m], each once, the least first; none without."""
    return sorted({radius for _, radius in _nominal_radii(campaign)})


def _nominal_radii(campaign: CampaignResults) -> list[tuple[str, float]]:
    """End of the drawn key, and radius in the scenario [m], of each servicer; none where the scenario has no radius."""
    scenario = campaign.info.get("scenario", {})
    changes = {each.get("name"): each.get("limits") or {} for each in scenario.get("servicers", [])}
    ends = {f"/{name}": changes.get(name, {}) for name in campaign.servicer_names} or {"": {}}
    common = scenario.get("limits", {})
    radii = {end: own.get("keep_out_m", common.get("keep_out_m")) for end, own in ends.items()}
    return [(end, float(radius)) for end, radius in radii.items() if radius is not None]


def rankable_scalars(campaign: CampaignResults) -> dict[str, np.ndarray]:
    """Dispersed scalars (runs,) that can be ranked: all but the categorical ones, such as kinds of fault."""
    return {key: values for key, values in dispersed_scalars(campaign).items() if not is_categorical(key)}


def is_categorical(key: str) -> bool:
    """Whether the numbers of a dispersed key, such as `fault.kind/second`, are codes without an order."""
    return key.partition("/")[0] in _CATEGORICAL_KEYS
