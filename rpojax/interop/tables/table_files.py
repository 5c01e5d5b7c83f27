"""Files of tables: CSV and Parquet, one table a file, and MAT and NPZ, all tables in one."""

import csv
import io
import json
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal, get_args

import numpy as np

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.interop.tables.campaign_tables import Table
from rpojax.optional_packages import require_package

FileFormat = Literal["csv", "parquet", "mat", "npz"]
FILE_FORMATS: Final[tuple[FileFormat, ...]] = get_args(FileFormat)

_MAT_NAME_LENGTH: Final = 63
"""Letters of a name in MATLAB."""


def paths_of_tables(out: Path, names: Sequence[str], form: FileFormat) -> dict[str, Path]:
    """Files that are written by what they hold: one for each table and one for `columns`, or one for all."""
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
