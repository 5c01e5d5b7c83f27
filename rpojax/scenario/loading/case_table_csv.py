"""CSV file of a case table: one row for each run, with keys of the scenario as header."""

import csv
import io
import math
import re
from pathlib import Path

from rpojax.errors import MISSING, ScenarioError
from rpojax.physics.plant_options import is_fault_kind
from rpojax.untrusted.file_reading import FileError, FileKind
from rpojax.untrusted.text_reading import read_text

MAX_CELLS = 1_000_000
MAX_COLUMNS = 1000

Columns = dict[str, list[float] | list[str]]

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,4})?", re.ASCII)


def read_columns(path: Path) -> Columns:
    """Columns of a case table by key.

    Raises:
        ScenarioError: the file cannot be read, is too large, or is no table of finite numbers under distinct keys.
    """
    rows = _rows(path, _text(path))
    header, body = [cell.strip() for cell in rows[0]], rows[1:]
    twice = [key for key in header if header.count(key) > 1 or not key]
    if twice:
        raise _table_error(path, 1, twice[0], "distinct keys of the scenario as header")
    if not body:
        raise _table_error(path, 2, MISSING, "a row for each run")
    for number, row in enumerate(body, start=2):
        if len(row) != len(header):
            raise _table_error(path, number, f"{len(row)} fields", f"{len(header)} as in the header")
    return {key: _column(path, key, [row[index].strip() for row in body]) for index, key in enumerate(header)}


def _text(path: Path) -> str:
    try:
        return read_text(path, FileKind.CASE_TABLE)
    except FileError as error:
        raise ScenarioError("design.file", f"{path} ({error.found})", "a readable CSV file in UTF-8") from None


def _rows(path: Path, text: str) -> list[list[str]]:
    """Rows of the file without trailing empty lines."""
    rows: list[list[str]] = []
    cells = 0
    try:
        for row in csv.reader(io.StringIO(text, newline=""), strict=True):
            rows.append(row)
            cells += max(1, len(row))
            if cells > MAX_CELLS or len(row) > MAX_COLUMNS:
                most = f"at most {MAX_COLUMNS} columns and {MAX_CELLS} values"
                raise _table_error(path, len(rows), "more", most)
    except csv.Error as error:
        raise _table_error(path, len(rows) + 1, str(error), "comma-separated values") from None
    while rows and not rows[-1]:
        rows.pop()
    if not rows or not rows[0]:
        raise _table_error(path, 1, MISSING, "keys of the scenario as header")
    return rows


def _column(path: Path, key: str, cells: list[str]) -> list[float] | list[str]:
    if is_fault_kind(key):
        return cells
    values: list[float] = []
    for number, cell in enumerate(cells, start=2):
        value = float(cell) if _NUMBER.fullmatch(cell) else math.nan
        if not math.isfinite(value):
            raise _table_error(path, number, cell[:60], f"a finite number for {key}")
        values.append(value)
    return values


def _table_error(path: Path, line: int, found: object, expected: str) -> ScenarioError:
    return ScenarioError(f"{path} row {line}", found, expected)
