"""Folders in YOLO's layout: `images`, and `labels` with a text file of boxes for each picture."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.training.labelled_pictures.dataset_faults import DatasetError
from rpojax.training.public_data.labelled_picture import LabelledPicture, reason_in_short
from rpojax.untrusted.file_reading import FileKind
from rpojax.untrusted.text_reading import read_text

_WORDS = 5
"""Words of a line: a class and four numbers."""
_NO_BOXES = frozenset({"classes.txt", "notes.txt", "obj.names.txt", "readme.txt", "train.txt", "val.txt", "test.txt"})
"""Texts that programs put beside those of boxes."""
_PICTURES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"}


def list_pictures(folder: Path, labels: Path | None = None) -> list[LabelledPicture]:
    """Pictures in `images` and its folders; a picture whose text file is empty or missing has no spacecraft.

    Args:
        folder: with `images` and `labels`
        labels: folder of the text files, by default `labels`

    Raises:
        DatasetError: a folder is missing, a file is not as expected, or boxes are of several classes or of no picture.
    """
    images, texts = folder / "images", labels or folder / "labels"
    for place in (images, texts):
        if not place.is_dir():
            raise DatasetError(f"{place}: found no such folder, expected images and labels, as in YOLO's layout")
    paths = sorted(path for path in _shown(images) if path.suffix.lower() in _PICTURES)
    if not paths:
        raise DatasetError(f"{images}: found no pictures, expected at least one")
    files = [(texts / path.relative_to(images)).with_suffix(".txt") for path in paths]
    if len(set(files)) < len(files):
        file = next(file for file, times in Counter(files).items() if times > 1)
        raise DatasetError(f"{file}: found two pictures of this name, expected one")
    if not any(file.exists() for file in files):
        raise DatasetError(f"{files[0]}: found no such file, nor that of another picture, expected boxes of some")
    _check_others(images, texts, files)
    classes: set[int] = set()
    boxes = [_boxes(file, classes) for file in files]
    if len(classes) > 1 or min(classes, default=0) < 0:
        raise DatasetError(f"{texts}: found classes {sorted(classes)[:9]}, expected one from 0 on, a spacecraft")
    others = "".join(f"class {number}" for number in classes if number)
    return [
        LabelledPicture(path, found, in_fractions=True, others=others) for path, found in zip(paths, boxes, strict=True)
    ]


def _shown(folder: Path) -> list[Path]:
    """Paths in a folder, without hidden files such as `._a.png` and hidden folders."""
    paths = folder.rglob("*")
    return [path for path in paths if not any(part.startswith(".") for part in path.relative_to(folder).parts)]


def _has_boxes(path: Path) -> bool:
    """Whether a text file is empty or begins with the words of a box; names of classes, for instance, are no labels."""
    first, _, _ = read_text(path, FileKind.ANNOTATIONS).partition("\n")
    try:
        return len([float(word) for word in first.split()]) in (0, _WORDS)
    except ValueError:
        return False


def _check_others(images: Path, texts: Path, files: Sequence[Path]) -> None:
    """Refuses texts that belong to no picture, without which others would count as empty or be left out."""
    lacking = [file for file in files if not file.exists()]
    names = {file.name for file in lacking}
    others = [
        path for path in _shown(texts) if path.suffix.lower() == ".txt" and path.name.lower() not in _NO_BOXES
    ] + [path for path in _shown(images) if path.suffix == ".txt" and path.name in names]
    unknown = sorted(path for path in set(others).difference(files) if _has_boxes(path))
    if not unknown:
        return
    reason = f" ({', '.join(sorted(_PICTURES))})"
    if lacking:
        reason = f", since {len(lacking)} pictures without such a file, as {lacking[0].name}, would count as empty"
    found = f"no picture of this name at the same place ({len(unknown)} such files)"
    raise DatasetError(f"{unknown[0]}: found {found}, expected one{reason}")


def _boxes(path: Path, classes: set[int]) -> np.ndarray:
    """Boxes (m, 4) in fractions of a text file; adds the classes that it names."""
    if not path.exists():
        return np.zeros((0, 4))
    try:
        lines = read_text(path, FileKind.ANNOTATIONS).split("\n")
        found = []
        for words in filter(None, map(str.split, lines)):
            if len(words) != _WORDS:
                of = "detections with their scores, or boxes with an angle" if len(words) == _WORDS + 1 else "outlines"
                likely = f", as of {of}" if len(words) > _WORDS else ""
                raise ValueError(f"a line of {len(words)} words{likely}")
            if any("_" in word for word in words):  # Python would read 1_0 as ten
                raise ValueError(f"{' '.join(words)!r:.60}")
            x, y, width, height = map(float, words[1:])
            classes.add(int(words[0]))
            found.append([x - 0.5 * width, y - 0.5 * height, x + 0.5 * width, y + 0.5 * height])
    except (RpojaxError, ValueError) as error:
        raise DatasetError(
            f"{path}: cannot be read ({reason_in_short(error)}), expected lines of class, centre x, centre y, width "
            "and height"
        ) from None
    boxes = np.array(found, dtype=float).reshape(-1, 4)
    if not (np.isfinite(boxes).all() and (np.abs(boxes) < 2.0).all()):
        raise DatasetError(f"{path}: found a box beyond its picture, expected fractions of width and height")
    return boxes
