"""A picture of a public data set with its boxes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rpojax.training.labelled_pictures.box_plausibility import BoxForm, implausible_boxes, implausible_pictures
from rpojax.training.labelled_pictures.dataset_faults import DatasetError, noticed
from rpojax.training.labelled_pictures.square_pictures import read_pictures
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
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
        others: what the data set calls its boxes, if that may be something else than spacecraft
    """

    path: Path
    boxes: np.ndarray
    in_fractions: bool = False
    background: str = "unknown"
    sides: tuple[int, int] | None = None
    others: str = ""


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
    read = read_pictures([entry.path for entry in pictures], size_px, [entry.sides for entry in pictures], labels)
    boxes, as_labelled = [], []
    for entry, scale, size in zip(pictures, read.scales, read.sizes, strict=True):
        sides = np.tile(size, 2).astype(float)
        found = entry.boxes * sides if entry.in_fractions else entry.boxes
        as_labelled.append(found)
        boxes.append((_inside(entry.path, found, sides) * scale).astype(np.float32))
    sentences = (
        *(f"boxes of {others} count as spacecraft" for others in {entry.others for entry in pictures} - {""}),
        *implausible_boxes(as_labelled, read.sizes, form),
        *implausible_pictures(read.codes, boxes, read.bits),
    )
    return DetectionDataset(
        read.codes,
        tuple(boxes),
        tuple(entry.background for entry in pictures),
        ("other",) * len(pictures),
        notes=noticed(labels, sentences),
        sizes=read.sizes,
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
