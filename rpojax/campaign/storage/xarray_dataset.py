"""A campaign as one labelled dataset, for those who have xarray."""

import importlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpojax.campaign.storage.campaign_folder import Campaign, array_units
from rpojax.campaign.storage.zarr_encoding import dimension_names
from rpojax.errors import RpojaxError

if TYPE_CHECKING:
    import xarray


_PREFIXES = {"metrics": "", "traces": "trace.", "drawn": "drawn.", "used": "used."}
"""What tells variables of one name apart: `delta_v_m_s` is a metric and a trace."""


def open_campaign(path: Path | str) -> "xarray.Dataset":
    """Finished runs of a campaign folder as an `xarray.Dataset`.

    Variables are metrics by their names, `trace.NAME` over `time` [s], `failed_at_s`, `failure_reason` and `completed`,
    and dispersed values as `drawn.KEY` and `used.KEY`, each with its unit as attribute `units`. Dimensions are `run`,
    with the run numbers as coordinate, `time`, and `axisI_N` for components. Attributes identify the campaign.

    Raises:
        RpojaxError: xarray is not installed, or the folder is no campaign that can be read.
    """
    try:
        labelled = importlib.import_module("xarray")
    except ModuleNotFoundError:
        raise RpojaxError(
            "open_campaign: found no xarray, expected the package (pip install 'rpojax[xarray]')"
        ) from None
    found = Campaign(path)
    variables: dict[str, Any] = {
        "failed_at_s": ("run", found.failed_at_s, {"units": "s"}),
        "failure_reason": ("run", found.failure_reason.astype(object), {"units": "1"}),
        "completed": ("run", found.completed, {"units": "1"}),
    }
    groups = {"metrics": found.metrics, "traces": found.traces, "drawn": found.drawn, "used": found.used}
    for group, arrays in groups.items():
        for name, values in arrays.items():
            shown = _PREFIXES[group] + name
            variables[shown] = (dimension_names(group, values), values, {"units": array_units(group, name)})
    coordinates = {"run": ("run", found.run_ids), "time": ("time", found.trace_time_s, {"units": "s"})}
    return labelled.Dataset(variables, coordinates, _identity(found))


def _identity(found: Campaign) -> dict[str, Any]:
    """What tells the campaign from others, in types that every file format takes."""
    keys = ("name", "description", "scenario_hash", "seed", "runs", "first_run", "block_size", "device", "created")
    plain = {key: found.configuration[key] for key in keys if key in found.configuration}
    return plain | {key: json.dumps(found.configuration[key]) for key in ("scenario", "versions", "stages")}
