"""SPARK: pictures of several spacecraft and debris, with a table of their boxes.

Source: Musallam et al., SPARK: Spacecraft Recognition leveraging Knowledge of Space Environment, 2021, and the tools
that are distributed with its editions of 2021, 2022 and 2024. The editions name their columns differently, and those
of 2021 and 2022 have the rows of a box before its columns.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.training.labelled_pictures.dataset_faults import DatasetError
from rpojax.training.public_data.labelled_picture import LabelledPicture, reason_in_short
from rpojax.untrusted.file_reading import FileKind, is_regular
from rpojax.untrusted.text_reading import read_text

_SPLITS = ("val", "validation", "validate", "test", "train")
"""Parts of an edition, of which the first one that exists counts: those not meant for training come first."""
_ENDINGS = ("", " labels", "_labels")
_SUFFIXES = (".png", ".jpg")


@dataclass(frozen=True)
class _Columns:
    """Columns of an edition: file name, name of the spacecraft, and box; `order` gives left, top, right, bottom."""

    name: str
    craft: str
    box: str
    order: tuple[int, int, int, int]


_EDITIONS = (
    _Columns("Image name", "Class", "Bounding box", (0, 1, 2, 3)),  # 2024
    _Columns("filename", "class", "bbox", (1, 0, 3, 2)),  # 2022
    _Columns("image", "class", "bbox", (1, 0, 3, 2)),  # 2021
)


def list_pictures(folder: Path, labels: Path | None = None) -> list[LabelledPicture]:
    """Pictures of the folder that a table names.

    Args:
        folder: with the table and the pictures, such as `val.csv` and `val`, or `images`
        labels: the table, by default that of validation, of test, or of training, whichever is there first

    Raises:
        DatasetError: a file is missing or not as expected.
    """
    if labels is None:
        tables = [folder / f"{split}{ending}.csv" for split in _SPLITS for ending in _ENDINGS]
        labels = next(filter(is_regular, tables), None)
    if labels is None:
        raise DatasetError(f"{folder}: found no table such as val.csv or train.csv, expected one, as in SPARK")
    try:
        text = read_text(labels, FileKind.CASE_TABLE)
        reader = csv.DictReader(io.StringIO(text, newline=""))
        names, rows = reader.fieldnames or (), list(reader)
    except (RpojaxError, csv.Error) as error:
        raise DatasetError(
            f"{labels}: cannot be read ({reason_in_short(error)}), expected a table as in SPARK"
        ) from None
    columns = _columns(labels, names)
    if not rows:
        raise DatasetError(f"{labels}: found no rows, expected one for each picture")
    return [_picture(folder, labels, columns, line, row) for line, row in enumerate(rows, start=2)]


def _columns(labels: Path, names: Sequence[str]) -> _Columns:
    """Columns of the edition of a table with columns of these names."""
    fitting = [edition for edition in _EDITIONS if {edition.name, edition.craft, edition.box} <= set(names)]
    if len(fitting) == 1 and len(set(names)) == len(names):
        return fitting[0]
    found = f"columns {', '.join(map(str, names))}"[:120].replace("\n", " ")
    known = " or ".join(f"{each.name}, {each.craft} and {each.box}" for each in _EDITIONS)
    raise DatasetError(f"{labels}: found {found}, expected {known}, each once and of one edition")


def _picture(
    folder: Path, labels: Path, columns: _Columns, line: int, row: Mapping[str, str | None]
) -> LabelledPicture:
    name, craft, box = (row[column] or "" for column in (columns.name, columns.craft, columns.box))
    if not (_is_name(name) and (_is_name(craft) or not craft)):
        raise DatasetError(f"{labels} line {line}: found {name!r:.60} of {craft!r:.60}, expected names without folders")
    try:
        edges = np.array([float(word) for word in box.strip(" ()[]").split(",")]).reshape(4)
        if "_" in box or not np.isfinite(edges).all():
            raise ValueError
    except ValueError:
        words = ("left", "top", "right", "bottom")
        order = ", ".join(words[index] for index in np.argsort(columns.order))
        raise DatasetError(f"{labels} line {line}: found {box!r:.60}, expected a box as ({order})") from None
    places = _places(folder, labels.stem, craft, name)
    found = next(filter(is_regular, places), None)
    if found is None:
        raise DatasetError(f"{places[0]}: found no such file, expected a picture that line {line} of {labels} names")
    return LabelledPicture(found, edges[None, list(columns.order)], background=craft or "unknown")


def _is_name(text: str) -> bool:
    return text not in ("", "..") and Path(text).name == text


def _places(folder: Path, split: str, craft: str, name: str) -> Sequence[Path]:
    """Where a picture may be; the tables of 2022 have the names of PNG files, and the pictures are JPEG files."""
    for ending in _ENDINGS[1:]:
        split = split.removesuffix(ending)
    folders = (
        folder / split,  # 2022
        folder / split / craft,  # 2021
        folder / "images" / craft / split,  # 2024
        folder / craft / split,
        folder,
    )
    names = [name, *(str(Path(name).with_suffix(suffix)) for suffix in _SUFFIXES if Path(name).suffix != suffix)]
    return [place / each for each in names for place in folders]
