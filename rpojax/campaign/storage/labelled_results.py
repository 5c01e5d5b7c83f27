"""Results of runs with labels: an `xarray.Dataset` with named dimensions and units, and a `pandas.DataFrame`."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rpojax.campaign.storage.arrays.zarr_encoding import array_units
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.metrics import metric_catalogue
from rpojax.optional_packages import require_package
from rpojax.scenario.plugins import plugin_registry

if TYPE_CHECKING:
    import pandas
    import xarray

Arrays = Mapping[str, np.ndarray]

_STATUS_UNITS = {"failed_at_s": "s"}
_OF_USED: Final = "used."
"""Prefix of values read back from the runs, which have the keys of those drawn."""
_OF_SERVICER: Final = "servicer_"
_OF_RUN: Final = (
    "abort_reason", "goal_reached_at_s", "unmet_conditions", "corridor_ahead_m", "corridor_aside_m", "arrival_place_P_m"
)  # fmt: skip
"""Arrays of the phases that a run has once."""
_QUATERNIONS: Final = ("attitude", "mounting")
"""Last words of keys of quaternions, real part first."""


@dataclass(frozen=True)
class Labels:
    """Coordinates of the results: (runs,) run numbers, (samples,) times [s], names of phases and of servicers."""

    run_ids: np.ndarray
    trace_time_s: np.ndarray
    phases: Sequence[str] = ()
    servicers: Sequence[str] = ()


def dataset(
    labels: Labels, status: Arrays, groups: Mapping[str, Arrays], configuration: CampaignConfiguration
) -> "xarray.Dataset":
    """Dataset of runs, of their `status` (runs,) and the arrays of groups by the group's name.

    Groups of the servicers of a team, (runs, servicers, ...), are those with `servicer_` before their name.

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
                shown = variable_name(group, name, groups["metrics"])
                named = _phase_names(values, labels.phases) if name == "transition_phase" else values
                variables[shown] = (_dimensions(group, name, values), named, _attributes(group, name))
    coordinates: dict[str, Any] = {
        "run": ("run", labels.run_ids),
        "time": ("time", labels.trace_time_s, {"units": "s"}),
        "phase": ("phase", list(labels.phases)),
        "servicer": ("servicer", list(labels.servicers)),
        "axis": ("axis", ["x", "y", "z"]),
        "quaternion": ("quaternion", ["w", "x", "y", "z"]),
    }
    used = {"run", "time", *(name for dimensions, _, _ in variables.values() for name in np.atleast_1d(dimensions))}
    shown = {name: values for name, values in coordinates.items() if name in used}
    return labelled.Dataset(variables, shown, _dataset_attributes(configuration))


def _phase_names(numbers: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Names of phases by their numbers, empty where there is none."""
    inside = (numbers >= 0) & (numbers < len(names))
    return np.where(inside, np.array([*names, ""], dtype=object)[np.where(inside, numbers, -1).astype(int)], "")


def variable_name(group: str, name: str, metrics: Collection[str]) -> str:
    """Name of an array of a group: its own where no other has it.

    A trace with the name of one of the `metrics` is `NAME_over_time`, what each phase has `NAME_by_phase`, and each
    servicer `NAME_by_servicer`; a value read back is `used.KEY`.
    """
    own = group.removeprefix(_OF_SERVICER)
    if own == "traces" and name in metrics:
        name = f"{name}_over_time"
    elif own == "phases" and _is_of_each_phase(name):
        name = f"{name}_by_phase"
    elif own == "used":
        name = f"{_OF_USED}{name}"
    return f"{name}_by_servicer" if group != own else name


def _is_of_each_phase(name: str) -> bool:
    return name not in _OF_RUN and not name.startswith("transition_")


def _dimensions(group: str, name: str, values: np.ndarray) -> tuple[str, ...]:
    """Names of the axes of an array, by what they are."""
    own = group.removeprefix(_OF_SERVICER)
    first = ("run",) if own == group else ("run", "servicer")
    shape = values.shape[len(first) :]
    if own == "traces":
        return (*first, "time")
    if own == "phases" and name not in _OF_RUN:
        return (*first, *(("phase",) if _is_of_each_phase(name) else ("transition",))[: len(shape)])
    if shape == (4,) and name.rpartition(".")[2] in _QUATERNIONS:
        return (*first, "quaternion")
    if shape == (3,) and not name.startswith("wheels."):
        return (*first, "axis")
    return (*first, *(f"axis{place}_{size}" for place, size in enumerate(shape, start=1)))


def _attributes(group: str, name: str) -> dict[str, str]:
    """Unit of an array, and the title of a metric."""
    metric = metric_catalogue.find(name) if group.removeprefix(_OF_SERVICER) == "metrics" else None
    return {"units": array_units(group, name), **({} if metric is None else {"long_name": metric.title})}


def data_frame(run_ids: np.ndarray, status: Arrays, groups: Mapping[str, Arrays]) -> "pandas.DataFrame":
    """Table with a row for each run by its number, columns of `status` (runs,) and of the components of groups.

    Raises:
        MissingExtraError: pandas is not installed.
    """
    tables = require_package("pandas")
    columns = dict(status)
    for group, arrays in groups.items():
        for name, values in arrays.items():
            columns |= dict(_components(variable_name(group, name, groups["metrics"]), values))
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
