"""A campaign as an `xarray.Dataset` with named dimensions and units."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpojax.campaign.storage.arrays.array_units import array_units
from rpojax.campaign.storage.arrays.zarr_encoding import dimension_names
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.optional_packages import require_package

if TYPE_CHECKING:
    import xarray


_PREFIXES = {"metrics": "", "traces": "trace.", "drawn": "drawn.", "used": "used.", "phases": "phase."}
"""Prefix of the variables of each group: some names, such as `delta_v_m_s`, occur in several."""


def open_campaign(path: Path | str) -> "xarray.Dataset":
    """Finished runs of a campaign folder as an `xarray.Dataset`.

    Variables are metrics by their names, `trace.NAME` over `time` [s], `failed_at_s`, `failure_reason`, `outcome` and
    `completed`, dispersed values as `drawn.KEY` and `used.KEY`, and those of phases as `phase.NAME`, each with its unit
    as attribute `units`. Dimensions are `run`, with the run numbers as coordinate, `time`, and `axisI_N` for
    components. Attributes identify the campaign.

    Raises:
        RpojaxError: xarray is not installed, or the folder is no campaign that can be read.
    """
    labelled = require_package("xarray")
    campaign = Campaign(path)
    variables: dict[str, Any] = {
        "failed_at_s": ("run", campaign.failed_at_s, {"units": "s"}),
        "failure_reason": ("run", campaign.failure_reason.astype(object), {"units": "1"}),
        "outcome": ("run", campaign.outcomes.astype(object), {"units": "1"}),
        "completed": ("run", campaign.completed, {"units": "1"}),
    }
    groups = {
        "metrics": campaign.metrics,
        "traces": campaign.traces,
        "drawn": campaign.drawn,
        "used": campaign.used,
        "phases": campaign.phases,
    }
    for group, arrays in groups.items():
        for name, values in arrays.items():
            units = {"units": array_units(group, name)}
            variables[_PREFIXES[group] + name] = (dimension_names(group, values), values, units)
    coordinates = {"run": ("run", campaign.run_ids), "time": ("time", campaign.trace_time_s, {"units": "s"})}
    return labelled.Dataset(variables, coordinates, _dataset_attributes(campaign))


def _dataset_attributes(campaign: Campaign) -> dict[str, Any]:
    """Configuration of the campaign, in types that every file format can hold."""
    record = campaign.configuration.to_record()
    keys = ("name", "description", "scenario_hash", "seed", "runs", "first_run", "block_size", "device", "created")
    plain = {key: record[key] for key in keys}
    return plain | {key: json.dumps(record[key]) for key in ("scenario", "versions", "stages")}
