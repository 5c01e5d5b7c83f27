"""Results of runs with labels: an `xarray.Dataset` with named dimensions and units, and a `pandas.DataFrame`."""

import json
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rpojax.campaign.storage.arrays.zarr_encoding import array_units, dimension_names
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.metrics import metric_catalogue
from rpojax.optional_packages import require_package
from rpojax.scenario.plugins import plugin_registry

if TYPE_CHECKING:
    import pandas
    import xarray

Arrays = Mapping[str, np.ndarray]

_PREFIXES = {"metrics": "", "traces": "trace.", "drawn": "drawn.", "used": "used.", "phases": "phase."}
"""Prefix of the variables of each group: some names, such as `delta_v_m_s`, occur in several."""
_STATUS_UNITS = {"failed_at_s": "s"}


def dataset(
    run_ids: np.ndarray,
    trace_time_s: np.ndarray,
    status: Arrays,
    groups: Mapping[str, Arrays],
    configuration: CampaignConfiguration,
) -> "xarray.Dataset":
    """Dataset of runs over `run` and `time`, of their `status` (runs,) and the arrays of groups by the group's name.

    Raises:
        MissingExtraError: xarray is not installed.
    """
    labelled = require_package("xarray")
    variables: dict[str, Any] = {
        name: ("run", values, {"units": _STATUS_UNITS.get(name, "1")}) for name, values in status.items()
    }
    with metric_catalogue.metrics_of_scenario(plugin_registry.recorded_metrics(configuration.to_record())):
        for group, arrays in groups.items():
            for name, values in arrays.items():
                units = {"units": array_units(group, name)}
                variables[_PREFIXES[group] + name] = (dimension_names(group, values), values, units)
    coordinates = {"run": ("run", run_ids), "time": ("time", trace_time_s, {"units": "s"})}
    return labelled.Dataset(variables, coordinates, _dataset_attributes(configuration))


def data_frame(run_ids: np.ndarray, status: Arrays, groups: Mapping[str, Arrays]) -> "pandas.DataFrame":
    """Table with a row for each run by its number, columns of `status` (runs,) and of the components of groups.

    Raises:
        MissingExtraError: pandas is not installed.
    """
    tables = require_package("pandas")
    columns = dict(status)
    for group, arrays in groups.items():
        for name, values in arrays.items():
            columns |= dict(_components(_PREFIXES[group] + name, values))
    return tables.DataFrame(columns, index=tables.Index(run_ids, name="run_id"))


def _components(name: str, values: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Columns `NAME` (runs,), or `NAME[0]`, `NAME[1]`, ... of an array with components."""
    if values.ndim == 1:
        yield name, values
        return
    for place in np.ndindex(values.shape[1:]):
        yield name + "".join(f"[{index}]" for index in place), values[(slice(None), *place)]


def _dataset_attributes(configuration: CampaignConfiguration) -> dict[str, Any]:
    """Configuration of the campaign, in types that every file format can hold."""
    record = configuration.to_record()
    keys = ("name", "description", "scenario_hash", "seed", "runs", "first_run", "block_size", "device", "created")
    plain = {key: record[key] for key in keys}
    return plain | {key: json.dumps(record[key]) for key in ("scenario", "versions", "stages")}
