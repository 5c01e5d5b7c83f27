"""Dispersed quantities of a campaign as named scalars."""

import numpy as np

from rpojax.report.campaign_results import CampaignResults
from rpojax.scenario.dispersed_numbers.run_values import values_of_runs
from rpojax.scenario.parameter_keys import component_columns

_CATEGORICAL_KEYS = ("fault.kind", "fault.wheel")
"""Keys whose numbers are codes without an order."""


def dispersed_scalars(campaign: CampaignResults) -> dict[str, np.ndarray]:
    """Every dispersed scalar (runs,); a vector has one entry per component, named `key[0]`, `key[1]`, ..."""
    return component_columns({key: np.asarray(values, dtype=np.float64) for key, values in campaign.drawn.items()})


def keep_out_radii(campaign: CampaignResults) -> np.ndarray | None:
    """Radius of every run's keep-out sphere [m], (runs,), or (1,) where all have the same; None without one."""
    nominal = campaign.info.get("scenario", {}).get("limits", {}).get("keep_out_m")
    if nominal is None:
        return None
    radii = values_of_runs(campaign.drawn, "limits.keep_out_m", nominal)
    return radii if radii.size else None


def rankable_scalars(campaign: CampaignResults) -> dict[str, np.ndarray]:
    """Dispersed scalars (runs,) that can be ranked: all but the categorical ones, such as kinds of fault."""
    return {key: values for key, values in dispersed_scalars(campaign).items() if key not in _CATEGORICAL_KEYS}
