"""SPARK: pictures of several spacecraft and debris, with a table of their boxes.

Source: Musallam et al., SPARK: Spacecraft Recognition leveraging Knowledge of Space Environment, 2021.
"""

import ast
import csv
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.training.public_data.labelled_picture import LabelledPicture
from rpojax.training.synthetic_data.detection_dataset import DatasetError
from rpojax.untrusted.file_reading import FileKind, read_bytes

LABEL_FILES = ("val.csv", "validation.csv", "test.csv", "train.csv")
"""Names of label files, of which the first one that is there counts: pictures that are not meant for training first."""
NAME, CRAFT, BOX = "Image name", "Class", "Bounding box"
"""Columns: file name, name of the spacecraft, and box as (left, top, right, bottom) in pixels."""


def list_pictures(folder: Path, labels: Path | None = None) -> list[LabelledPicture]:
    """Pictures of the folder that a table names.

    Args:
        folder: with the table and the folder of its pictures, such as `val.csv` and `val`
        labels: the table, by default the first of `LABEL_FILES`

    Raises:
        DatasetError: a file is missing or not as expected.
    """
    labels = labels or next((folder / name for name in LABEL_FILES if (folder / name).is_file()), None)
    if labels is None:
        raise DatasetError(f"{folder}: found none of {', '.join(LABEL_FILES)}, expected one, as in SPARK")
    try:
        text = read_bytes(labels, FileKind.CASE_TABLE).decode("utf-8-sig")
    except (RpojaxError, UnicodeDecodeError) as error:
        raise DatasetError(f"{labels}: cannot be read ({error!s:.120}), expected a table as in SPARK") from None
    rows = list(csv.DictReader(io.StringIO(text)))
    missing = [column for column in (NAME, BOX) if not rows or column not in rows[0]]
    if missing:
        raise DatasetError(f"{labels}: found no {', '.join(missing)}, expected columns {NAME}, {CRAFT} and {BOX}")
    return [_picture(folder, labels, line, row) for line, row in enumerate(rows, start=2)]


def _picture(folder: Path, labels: Path, line: int, row: Mapping[str, str | None]) -> LabelledPicture:
    name, craft = row[NAME] or "", row.get(CRAFT) or ""
    if Path(name).name != name or Path(craft).name != craft or not name:
        raise DatasetError(f"{labels} line {line}: found {name!r:.60} of {craft!r:.60}, expected names without folders")
    try:
        box = np.array(ast.literal_eval(row[BOX] or ""), dtype=float).reshape(4)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        raise DatasetError(
            f"{labels} line {line}: found {row[BOX]!r:.60}, expected a box as (left, top, right, bottom)"
        ) from None
    split = labels.stem
    places = [folder / split / name, folder / split / craft / name, folder / craft / split / name, folder / name]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise DatasetError(f"{places[0]}: found no such file, expected a picture that line {line} of {labels} names")
    return LabelledPicture(found, box[None], background=craft or "unknown")
