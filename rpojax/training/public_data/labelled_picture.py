"""A picture of a public data set with its boxes."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rpojax.training.synthetic_data.box_plausibility import BoxForm, dark_boxes, implausible_boxes
from rpojax.training.synthetic_data.detection_dataset import (
    DatasetError,
    DetectionDataset,
    noticed,
    read_square_picture,
)
from rpojax.untrusted.file_reading import FileError


@dataclass(frozen=True)
class LabelledPicture:
    """A picture and the boxes of its spacecraft.

    Attributes:
        path: of its file
        boxes: (m, 4) left, top, right, bottom; in pixels of the file, or in fractions of its width and height
        in_fractions: whether boxes are in fractions
        background: as the data set names it, or 'unknown'
        sides: width and height [px] that the file must have for its boxes to be right, where they are known
    """

    path: Path
    boxes: np.ndarray
    in_fractions: bool = False
    background: str = "unknown"
    sides: tuple[int, int] | None = None


def reason_in_short(error: Exception) -> str:
    """Why a file of labels cannot be read, in a part of a line."""
    return " ".join((error.found if isinstance(error, FileError) else str(error)).split())[:120]


def evenly_chosen(pictures: Sequence[LabelledPicture], limit: int | None) -> list[LabelledPicture]:
    """At most `limit` pictures, spread evenly over all, since neighbours in a data set are often alike."""
    if limit is None or limit >= len(pictures):
        return list(pictures)
    return [pictures[round(index)] for index in np.linspace(0, len(pictures) - 1, limit)]


def to_dataset(pictures: Sequence[LabelledPicture], size_px: int, form: BoxForm, labels: Path) -> DetectionDataset:
    """Data set of pictures that are read now, each resized and padded to a square of `size_px`.

    What is unlikely about the boxes is in its `notes`, and each note, about `labels`, is a `Notice`.

    Raises:
        DatasetError: a picture cannot be read or stands in the list twice, or a box lies outside of its picture.
    """
    times = Counter(entry.path for entry in pictures)
    if len(times) < len(pictures):
        path = next(path for path, number in times.items() if number > 1)
        raise DatasetError(f"{path}: found {times[path]} entries of {labels} with this picture, expected one for each")
    codes = np.zeros((len(pictures), size_px, size_px, 3), np.uint8)
    boxes, as_labelled, sizes = [], [], []
    for index, entry in enumerate(pictures):
        picture = read_square_picture(entry.path, size_px, entry.sides)
        sides = np.array([picture.width, picture.height] * 2, dtype=float)
        found = entry.boxes * sides if entry.in_fractions else entry.boxes
        codes[index] = picture.codes
        as_labelled.append(found)
        sizes.append((picture.width, picture.height))
        boxes.append((_inside(entry.path, found, sides) * picture.scale).astype(np.float32))
    return DetectionDataset(
        codes,
        tuple(boxes),
        tuple(entry.background for entry in pictures),
        ("other",) * len(pictures),
        notes=noticed(labels, (*implausible_boxes(as_labelled, sizes, form), *dark_boxes(codes, boxes))),
    )


def _inside(path: Path, boxes: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Boxes cut to the picture.

    Raises:
        DatasetError: one is empty, or has no part in the picture.
    """
    cut = np.clip(boxes, 0.0, sides)
    empty = ~((cut[:, 2] > cut[:, 0]) & (cut[:, 3] > cut[:, 1]))
    if empty.any():
        box = [round(float(edge), 1) for edge in boxes[empty][0]]
        width, height = sides[:2]
        raise DatasetError(
            f"{path}: found the box {box}, expected left, top, right, bottom within {width:g} x {height:g} px"
        )
    return cut
