"""Results of a campaign as tables with one number a cell, in files that other tools read."""

import csv
import io
import json
import re
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Final, Literal, get_args

import numpy as np

from rpojax.campaign.storage.arrays.zarr_encoding import array_units
from rpojax.campaign.storage.atomic_outputs import check_replaceable, write_atomically
from rpojax.campaign.storage.campaign_folder import Campaign, of_servicer
from rpojax.errors import Notice, RpojaxError
from rpojax.metrics import metric_catalogue
from rpojax.optional_packages import require_package
from rpojax.scenario.plugins import plugin_registry

TableName = Literal["runs", "metrics", "draws", "traces", "history"]
TABLE_NAMES: Final[tuple[TableName, ...]] = get_args(TableName)
"""What can be exported."""
FileFormat = Literal["csv", "parquet", "mat", "npz"]
FILE_FORMATS: Final[tuple[FileFormat, ...]] = get_args(FileFormat)
_MAT_NAME_LENGTH: Final = 63
"""Letters of a name in MATLAB."""


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

    `runs`, `metrics` and `draws` have one row a run, and `runs` has the columns of both others; `traces` has one row
    for each run and sample, `history` one for each run and tick: of all runs with a stored history unless one is named.

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
        case "runs":
            return Table(name, [*_metric_columns(campaign, rows), *_grouped(campaign.drawn, "drawn", rows)])
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
            if name == "phase" and campaign.phase_names and values.ndim == 1:
                shown = np.array(campaign.phase_names)[values.astype(int)]
                columns.append(Column(f"phase_name{suffix}", shown, "1", "Name of the phase of the mission."))
    return columns


def _components(name: str, values: np.ndarray, unit: str) -> list[Column]:
    """A column for every component of an array (rows, ...): `NAME[0]`, `NAME[1]`, ..."""
    if values.ndim == 1:
        return [Column(name, values, unit)]
    places = product(*map(range, values.shape[1:]))
    return [Column(f"{name}[{','.join(map(str, at))}]", values[(slice(None), *at)], unit) for at in places]


def paths_of_tables(out: Path, names: Sequence[str], form: FileFormat) -> dict[str, Path]:
    """Content -> file to write: one file for each table and one for `columns`, or a single file for all."""
    if form in ("mat", "npz"):
        return {"all": out}
    paths = {name: out if len(names) == 1 else out.with_name(f"{out.stem}_{name}{out.suffix}") for name in names}
    return paths | ({"columns": out.with_name(f"{out.stem}_columns.csv")} if form == "csv" else {})


def write_tables(tables: Sequence[Table], out: Path, form: FileFormat, about: Mapping[str, Any]) -> list[Path]:
    """Writes tables and the units and meanings of their columns; returns the paths of the files.

    Args:
        tables: to write
        out: file, or with several tables in CSV or Parquet the pattern of their names
        form: format
        about: what identifies the campaign, in the types of JSON

    Raises:
        OutputError: a file cannot be written.
        MissingExtraError: Parquet needs a package that is not installed.
    """
    paths = paths_of_tables(out, [table.name for table in tables], form)
    if form == "npz":
        return [write_atomically(paths["all"], _npz(tables, about))]
    if form == "mat":
        return [write_atomically(paths["all"], _mat(tables, about))]
    encode: Callable[[Table], bytes] = _csv if form == "csv" else lambda table: _parquet(table, about)
    written = [write_atomically(paths[table.name], encode(table)) for table in tables]
    if form == "csv":
        written.append(write_atomically(paths["columns"], _csv_rows(_descriptions(tables))))
    return written


def _descriptions(tables: Sequence[Table]) -> Iterator[Sequence[Any]]:
    """Head and rows of the table of all columns."""
    yield ("table", "column", "unit", "meaning")
    for table in tables:
        for column in table.columns:
            yield (table.name, column.name, column.unit, column.meaning)


def _csv(table: Table) -> bytes:
    columns = [_cells(column.values) for column in table.columns]
    return _csv_rows([[column.name for column in table.columns], *zip(*columns, strict=True)])


def _csv_rows(rows: Any) -> bytes:
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def _cells(values: np.ndarray) -> list[Any]:
    """Cells that read back to the same numbers; nothing for NaN, and 1 or 0 for flags."""
    if values.dtype == bool:
        return values.astype(int).tolist()
    if not np.issubdtype(values.dtype, np.floating):
        return values.tolist()
    # The shortest text of the type itself: 0.1 in single precision is not 0.10000000149011612.
    return [
        "" if np.isnan(value) else repr(value.item()) if value.dtype == np.float64 else str(value) for value in values
    ]


def _parquet(table: Table, about: Mapping[str, Any]) -> bytes:
    arrow = require_package("pyarrow")
    parquet = require_package("pyarrow.parquet")
    arrays = [arrow.array(np.ascontiguousarray(column.values), from_pandas=True) for column in table.columns]
    fields = [
        arrow.field(column.name, array.type, metadata={"unit": column.unit, "meaning": column.meaning})
        for column, array in zip(table.columns, arrays, strict=True)
    ]
    schema = arrow.schema(fields, metadata={"rpojax": json.dumps(about)})
    stream = io.BytesIO()
    parquet.write_table(arrow.table(arrays, schema=schema), stream)
    return stream.getvalue()


def _npz(tables: Sequence[Table], about: Mapping[str, Any]) -> bytes:
    arrays = {f"{table.name}/{column.name}": column.values for table in tables for column in table.columns}
    arrays["columns"] = np.array([list(row) for row in _descriptions(tables)], dtype=str)
    arrays["about"] = np.array(json.dumps(about))
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.ascontiguousarray(values), allow_pickle=False)
            # A fixed date, so that the same results give the same bytes.
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0)), member.getvalue())
    return stream.getvalue()


def _mat(tables: Sequence[Table], about: Mapping[str, Any]) -> bytes:
    from scipy.io import savemat

    names = {table.name: mat_names([column.name for column in table.columns]) for table in tables}
    content: dict[str, Any] = {
        table.name: {names[table.name][column.name]: _mat_values(column.values)[:, None] for column in table.columns}
        for table in tables
    }
    head, *rows = _descriptions(tables)
    listed = [[*row[:2], names[row[0]][row[1]], *row[2:]] for row in rows]
    content["columns"] = np.array([[*head[:2], "field", *head[2:]], *listed], dtype=object)
    content["about"] = json.dumps(about)
    stream = io.BytesIO()
    savemat(stream, content, long_field_names=True, do_compression=True)
    return stream.getvalue()


def _mat_values(values: np.ndarray) -> np.ndarray:
    return values.astype(object) if values.dtype.kind in "UO" else values


def mat_names(columns: Sequence[str]) -> dict[str, str]:
    """Names of fields in MATLAB by the names of columns: letters, digits and underscores, all different."""
    names: dict[str, str] = {}
    for column in columns:
        plain = re.sub(r"\W+", "_", column).strip("_")
        plain = (plain if plain[:1].isalpha() else f"x_{plain}")[:_MAT_NAME_LENGTH]
        number = 1
        while plain in names.values():
            number += 1
            plain = f"{plain[: _MAT_NAME_LENGTH - 4]}_{number}"
        names[column] = plain
    return names


def export_tables(
    campaign: Campaign, out: Path, form: FileFormat, what: Sequence[str], run_id: int | None, force: bool
) -> list[Path]:
    """Writes tables of a campaign, as `rpojax.export` does; returns the paths of the files.

    A `Notice` says how many runs are left out because they are not simulated yet.

    Raises:
        RpojaxError: there is no such run or table, or the run has no history.
        OutputError: a file exists already or cannot be written.
        MissingExtraError: Parquet needs a package that is not installed.
    """
    names: list[TableName] = [name for name in TABLE_NAMES if name in what]
    for name in what or [""]:
        if name not in TABLE_NAMES:
            raise RpojaxError.of_argument("what", f"found {name!r}, expected some of {', '.join(TABLE_NAMES)}")
    check_replaceable(paths_of_tables(out, names, form).values(), force)
    tables = [make_table(campaign, name, run_id) for name in names]
    all_runs, finished = campaign.configuration.runs, len(campaign.run_ids)
    if run_id is None and finished < all_runs:
        warnings.warn(
            f"warning: {campaign.directory}: found {finished} of {all_runs} runs finished, expected all; the tables "
            "lack the others until `rpojax resume` has simulated them",
            Notice,
            stacklevel=2,
        )
    return write_tables(tables, out, form, _identity(campaign))


def _identity(campaign: Campaign) -> dict[str, Any]:
    """What identifies a campaign, in the types of JSON."""
    record = campaign.configuration.to_record()
    return {key: record[key] for key in ("name", "scenario_hash", "seed", "first_run", "runs", "id", "versions")}
