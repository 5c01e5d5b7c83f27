"""Annotations in COCO's format: entries of images, and their boxes."""

import dataclasses
from collections.abc import Hashable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.errors import RpojaxError
from rpojax.training.labelled_pictures.dataset_faults import DatasetError, repeated
from rpojax.untrusted.file_reading import FileError, FileKind
from rpojax.untrusted.json_reading import read_json

CATEGORY = "spacecraft"
_LEFT_TOP_SIZES = 1
"""Value of `bbox_mode`, which Detectron2 adds, of boxes as in COCO."""


@dataclasses.dataclass(frozen=True)
class Annotations:
    """Annotations of a file.

    Attributes:
        images: their entries, with `file_name`, `width` and `height`, and `craft` of one of its boxes
        boxes: for every image (m, 4) left, top, right, bottom [px]
        known: for every image (m, 4) whether it shows each edge
        outlined: (k, 4) the boxes that have an outline of polygons
        outlines: (k, 4) the boxes around these
        notes: what is unlikely about the categories
    """

    images: list[dict[str, Any]]
    boxes: list[np.ndarray]
    known: list[np.ndarray]
    outlined: np.ndarray
    outlines: np.ndarray
    notes: tuple[str, ...]

    @property
    def sizes(self) -> list[tuple[int, int]]:
        """Width and height of every image [px]."""
        return [(entry["width"], entry["height"]) for entry in self.images]


@dataclasses.dataclass(frozen=True)
class _Annotation:
    """A box (4) [px] of an image, which edges (4) it shows, and the box (4) around its outline, if it has one."""

    image: Hashable
    box: list[float]
    known: list[bool]
    outline: list[float] | None


def read_annotations(path: Path) -> Annotations:
    """Annotations of a file.

    Raises:
        DatasetError: it cannot be read, or is not as expected.
    """
    try:
        content = read_json(path, FileKind.ANNOTATIONS)
    except RpojaxError as error:
        reason = error.found if isinstance(error, FileError) else str(error)
        raise DatasetError(f"{path}: cannot be read ({reason}), expected annotations in COCO's format") from None
    try:
        found = _annotations(content)
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise DatasetError(f"{path}: found a fault at {error}, expected images and annotations as in COCO") from None
    if not found.images:
        raise DatasetError(f"{path}: found no images, expected at least one")
    return found


def _annotations(content: Any) -> Annotations:
    if isinstance(content, list):
        raise ValueError("a list, as of the boxes that a detector has found")
    images = {}
    _check_each_once("images of id", (entry["id"] for entry in content["images"]))
    for entry in content["images"]:
        sides = {side: int(entry[side]) for side in ("width", "height")}
        images[entry["id"]] = {**entry, "file_name": str(entry["file_name"]), **sides}
    _check_each_once("annotations of id", (note["id"] for note in content["annotations"] if "id" in note))
    notes = _category_notes(content)
    found = [_annotation(note, images) for note in content["annotations"]]
    of_image: dict[Hashable, list[_Annotation]] = {number: [] for number in images}
    for each in found:
        of_image[each.image].append(each)
    pairs = [(each.box, each.outline) for each in found if each.outline is not None]
    outlined, outlines = np.array(pairs, dtype=float).reshape(-1, 2, 4).swapaxes(0, 1)
    return Annotations(
        list(images.values()),
        [np.array([each.box for each in part], dtype=float).reshape(-1, 4) for part in of_image.values()],
        [np.array([each.known for each in part], bool).reshape(-1, 4) for part in of_image.values()],
        outlined,
        outlines,
        notes,
    )


def _check_each_once(what: str, numbers: Iterable[Hashable]) -> None:
    """Raises `ValueError` if there are several of a number."""
    if found := repeated(numbers):
        raise ValueError(f"{found[1]} {what} {found[0]}")


def _category_notes(content: Any) -> tuple[str, ...]:
    """A sentence if all boxes are of one among several categories whose name does not say spacecraft.

    Raises:
        ValueError: boxes are of several categories, or of one that is not listed.
    """
    listed = content.get("categories", [])
    _check_each_once("categories of id", (entry.get("id") for entry in listed))
    names = {entry.get("id"): str(entry.get("name")) for entry in listed}
    kinds = {note.get("category_id") for note in content["annotations"]}
    if len(kinds) > 1:
        raise ValueError(f"categories {sorted(map(str, kinds))}, of which one is meant to be a spacecraft")
    if names and (unlisted := kinds - names.keys() - {None}):
        raise ValueError(f"category {min(map(str, unlisted))}, which is not listed")
    used = [names.get(kind, "none") for kind in kinds]
    if len(names) < 2 or not used or used[0].casefold() == CATEGORY:
        return ()
    return (f"boxes of category {used[0]!r:.40}, one of the {len(names)} that are listed, count as spacecraft",)


def _annotation(note: Mapping[str, Any], images: Mapping[Hashable, dict[str, Any]]) -> _Annotation:
    """Annotation of one of `images`, whose entry gets its `craft`.

    Raises:
        ValueError: it is none of a spacecraft in one of them.
    """
    number = note["image_id"]
    if number not in images:
        same = [image for image in images if str(image) == str(number)]
        what = f", as {type(same[0]).__name__} and not {type(number).__name__}" if same else ""
        raise ValueError(f"an annotation of image {number!r:.40}, which is {'listed' if same else 'not listed'}{what}")
    if note.get("iscrowd") or note.get("ignore"):
        what = "a crowd" if note.get("iscrowd") else "a box to ignore"
        raise ValueError(f"{what} in image {number}, where each spacecraft has its box")
    if note.get("bbox_mode", _LEFT_TOP_SIZES) != _LEFT_TOP_SIZES:
        raise ValueError(f"bbox_mode {note['bbox_mode']!r:.20}, where left, top, width and height are meant")
    images[number]["craft"] = note.get("craft")
    left, top, width, height = _box(note["bbox"], images[number])
    return _Annotation(
        number,
        [left, top, left + width, top + height],
        _four_flags(note.get("known_edges", [True] * 4)),
        _around_outline(note.get("segmentation")),
    )


def _around_outline(segmentation: Any) -> list[float] | None:
    """Box around the polygons of an annotation; None if it has none, as with a mask.

    Raises:
        ValueError: they are no polygons.
    """
    if not isinstance(segmentation, list) or not segmentation:
        return None
    polygons = segmentation if isinstance(segmentation[0], list) else [segmentation]
    try:
        points = np.concatenate([np.array(polygon, dtype=float).reshape(-1, 2) for polygon in polygons])
    except (TypeError, ValueError):
        raise ValueError(f"segmentation {segmentation!r:.60}, which is no list of polygons") from None
    return [*points.min(axis=0).tolist(), *points.max(axis=0).tolist()] if len(points) else None


def _four_flags(values: Any) -> list[bool]:
    """Flags of the four edges of a box.

    Raises:
        ValueError: they are not four flags.
    """
    if not (isinstance(values, list) and len(values) == 4 and all(type(each) in (bool, int) for each in values)):
        raise ValueError(f"known_edges {values!r:.60}, where four of true and false are meant")
    return [bool(value) for value in values]


def _box(values: Any, image: Mapping[str, Any]) -> tuple[float, float, float, float]:
    """Left, top, width and height of a box, which overlaps its image and reaches beyond it by at most its size.

    Raises:
        ValueError: it is no such box.
    """
    left, top, width, height = map(float, values)
    spans = ((left, width, image["width"]), (top, height, image["height"]))
    if not all(size > 0.0 and -most <= low < most and 0.0 < low + size <= 2.0 * most for low, size, most in spans):
        raise ValueError(f"bbox {values} of an image of {image['width']} x {image['height']} px")
    return left, top, width, height
