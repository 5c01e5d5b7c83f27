"""Tables of a campaign: metrics, dispersed values, traces and histories as named columns with units."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final, Literal, get_args

import numpy as np

from rpojax.campaign.storage.arrays.array_units import array_units
from rpojax.campaign.storage.campaign_folder import Campaign, of_servicer
from rpojax.errors import RpojaxError
from rpojax.metrics import metric_catalogue
from rpojax.scenario.plugins import plugin_registry

TableName = Literal["metrics", "draws", "traces", "history"]
TABLE_NAMES: Final[tuple[TableName, ...]] = get_args(TableName)
"""What can be exported."""


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes:
        name: unique in its table
        values: (rows,) numbers, flags or texts; NaN for none
        unit: as text, `1` for dimensionless numbers
        meaning: in one sentence, empty where the name says it
    """

    name: str
    values: np.ndarray
    unit: str
    meaning: str = ""


@dataclass(frozen=True)
class Table:
    """Columns of equal length."""

    name: TableName
    columns: Sequence[Column]

    @property
    def row_count(self) -> int:
        """Number of rows."""
        return len(self.columns[0].values)


def make_table(campaign: Campaign, name: TableName, run_id: int | None = None) -> Table:
    """Table of the finished runs of a campaign, or of one of them.

    `metrics` and `draws` have one row a run, `traces` one for each run and sample, `history` one for each run and tick:
    of all runs with a stored history unless one is named.

    Raises:
        RpojaxError: there is no such run, or it has no history.
    """
    with metric_catalogue.metrics_of_scenario(plugin_registry.recorded_metrics(campaign.info)):
        return _make_table(campaign, name, run_id)


def _make_table(campaign: Campaign, name: TableName, run_id: int | None) -> Table:
    rows = np.arange(len(campaign.run_ids))
    if run_id is not None:
        rows = np.flatnonzero(campaign.run_ids == run_id)
        if not len(rows):
            raise RpojaxError.of_argument("run_id", f"found {run_id}, expected a finished run of the campaign")
    match name:
        case "metrics":
            return Table(name, list(_metric_columns(campaign, rows)))
        case "draws":
            return Table(name, [_run_ids(campaign, rows), *_grouped(campaign.drawn, "drawn", rows)])
        case "traces":
            return Table(name, list(_trace_columns(campaign, rows)))
        case "history":
            return _history_table(campaign, campaign.history_ids if run_id is None else [run_id])


def _run_ids(campaign: Campaign, rows: np.ndarray) -> Column:
    return Column("run_id", campaign.run_ids[rows], "1", "Number of the run.")


def _metric_columns(campaign: Campaign, rows: np.ndarray) -> Iterator[Column]:
    yield _run_ids(campaign, rows)
    yield Column("outcome", campaign.outcomes[rows].astype(str), "1", "How the run ended.")
    yield Column("completed", campaign.completed[rows], "1", "Whether the outcome is `completed`.")
    yield Column("failed_at_s", campaign.failed_at_s[rows], "s", "Since when a failed run is in its final state.")
    for name, values in campaign.metrics.items():
        metric = metric_catalogue.find(name)
        yield Column(name, values[rows], array_units("metrics", name), "" if metric is None else metric.meaning)


def _grouped(arrays: Mapping[str, np.ndarray], group: str, rows: np.ndarray) -> Iterator[Column]:
    for name, values in arrays.items():
        yield from _components(name, values[rows], array_units(group, name.partition("/")[0]))


def _trace_columns(campaign: Campaign, rows: np.ndarray) -> Iterator[Column]:
    time_s = campaign.trace_time_s
    yield Column("run_id", np.repeat(campaign.run_ids[rows], len(time_s)), "1", "Number of the run.")
    yield Column("time_s", np.tile(time_s, len(rows)), "s", "Time since the start.")
    for name, values in campaign.traces.items():
        samples = values[rows].reshape(len(rows) * len(time_s), *values.shape[2:])
        yield from _components(name, samples, array_units("traces", name))


def _history_table(campaign: Campaign, run_ids: Sequence[int]) -> Table:
    parts = [_history_columns(campaign, run_id) for run_id in run_ids]
    if not parts:
        raise RpojaxError("history: found no run with a stored history, expected some (--histories)")
    columns = [
        Column(column.name, np.concatenate([part[place].values for part in parts]), column.unit, column.meaning)
        for place, column in enumerate(parts[0])
    ]
    return Table("history", columns)


def _history_columns(campaign: Campaign, run_id: int) -> list[Column]:
    history = campaign.history(run_id)
    time_s = history["time_s"]
    columns = [
        Column("run_id", np.full(len(time_s), run_id), "1", "Number of the run."),
        Column("time_s", time_s, "s", "Time since the start."),
    ]
    names = campaign.servicer_names
    each = {f"/{name}": of_servicer(history, number) for number, name in enumerate(names)} or {"": history}
    for suffix, channels in each.items():
        for name, values in sorted(channels.items()):
            if name != "time_s":
                # What a run has once, such as its desired position, is repeated in every row.
                full = values if len(values) == len(time_s) else np.broadcast_to(values, (len(time_s), *values.shape))
                columns += _components(name + suffix, full, array_units("histories", name))
    return columns


def _components(name: str, values: np.ndarray, unit: str) -> list[Column]:
    """A column for every component of an array (rows, ...): `NAME[0]`, `NAME[1]`, ..."""
    if values.ndim == 1:
        return [Column(name, values, unit)]
    places = product(*map(range, values.shape[1:]))
    return [Column(f"{name}[{','.join(map(str, at))}]", values[(slice(None), *at)], unit) for at in places]
