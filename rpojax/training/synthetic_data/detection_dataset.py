"""Data sets of images with the boxes of spacecraft, in memory and in folders in COCO format."""

import dataclasses
import json
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.errors import Notice, OutputError, RpojaxError
from rpojax.training.synthetic_data.box_plausibility import dark_boxes, implausible_boxes, outlines_elsewhere
from rpojax.training.synthetic_data.composites import GENERATORS, SIZE_PX, Composite, CompositeMix, random_composite
from rpojax.training.synthetic_data.meshes.packaged_target import PACKAGED_TARGET
from rpojax.training.synthetic_data.scenery.earth_textures import EarthTextures
from rpojax.training.synthetic_data.spacecraft_sprites import Sprite
from rpojax.untrusted.file_reading import FileError, FileKind, absolute_path, read_bytes
from rpojax.untrusted.json_reading import read_json
from rpojax.vision.imaging.image_files import UPRIGHT, check_size, orientation

CATEGORY = "spacecraft"
ANNOTATIONS = "annotations.json"
_LEFT_TOP_SIZES = 1
"""Value of `bbox_mode`, which Detectron2 adds, of boxes as in COCO."""


class DatasetError(RpojaxError):
    """A data set cannot be used."""


@dataclasses.dataclass(frozen=True)
class DetectionDataset:
    """Square images with their boxes.

    Attributes:
        images: (n, p, p, 3) 8 bit sRGB codes
        boxes: for every image (m, 4) left, top, right, bottom [px]
        backgrounds: background as the data set names it, or 'unknown'
        craft: 'target' for images of the packaged target, else 'other'
        known: for every image (m, 4) whether the image shows each edge; without it all count as known
        masks: (n, p, p) fraction 0..255 of each pixel that visible spacecraft cover, or None if nobody knows
        notes: what is unlikely about the boxes as they were read
    """

    images: np.ndarray
    boxes: tuple[np.ndarray, ...]
    backgrounds: tuple[str, ...]
    craft: tuple[str, ...] = ()
    known: tuple[np.ndarray, ...] = ()
    masks: np.ndarray | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.images)

    def subset(self, indices: np.ndarray) -> "DetectionDataset":
        """The images with the given indices."""
        return DetectionDataset(
            self.images[indices],
            tuple(self.boxes[i] for i in indices),
            tuple(self.backgrounds[i] for i in indices),
            tuple(self.craft[i] for i in indices) if self.craft else (),
            tuple(self.known[i] for i in indices) if self.known else (),
            None if self.masks is None else self.masks[indices],
            self.notes,
        )

    def known_edges(self, index: int) -> np.ndarray:
        """Whether an image shows each edge (m, 4) of its boxes."""
        return self.known[index] if self.known else np.ones((len(self.boxes[index]), 4), bool)


def concatenate(datasets: list[DetectionDataset]) -> DetectionDataset:
    """One data set of several; without masks unless all parts have them."""
    first, *others = datasets
    if not others:
        return first
    masks = [part.masks for part in datasets if part.masks is not None]
    return DetectionDataset(
        np.concatenate([part.images for part in datasets]),
        tuple(box for part in datasets for box in part.boxes),
        tuple(background for part in datasets for background in part.backgrounds),
        tuple(name for part in datasets for name in part.craft or ("other",) * len(part)),
        tuple(part.known_edges(index) for part in datasets for index in range(len(part))),
        np.concatenate(masks) if len(masks) == len(datasets) else None,
        tuple(note for part in datasets for note in part.notes),
    )


def write_dataset(
    folder: Path,
    count: int,
    seed: int,
    sprites: list[Sprite],
    earth: EarthTextures,
    provenance: str = "",
    on_progress: Callable[[int, int], None] = lambda done, total: None,
    mix: CompositeMix = GENERATORS[1],
) -> None:
    """Writes `count` composites as PNG images, then `annotations.json`, without which a folder is no data set.

    `provenance` is stored for `is_complete`.
    """
    for part in ("images", "masks"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    (folder / ANNOTATIONS).unlink(missing_ok=True)
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for index in range(count):
        composite = random_composite(np.random.default_rng([seed, index]), sprites, earth, mix=mix)
        images.append(_write_composite(folder, index, composite))
        for box, known, craft in zip(composite.boxes, composite.known, composite.craft, strict=True):
            annotations.append(_annotation(len(annotations) + 1, index + 1, box, known, craft))
        on_progress(index + 1, count)
    content = {
        "info": {"description": f"ray-traced spacecraft, seed {seed}", "made": provenance},
        "categories": [{"id": 1, "name": CATEGORY}],
        "images": images,
        "annotations": annotations,
    }
    partial = folder / f"{ANNOTATIONS}.part"
    partial.write_text(json.dumps(content, indent=1))
    partial.replace(folder / ANNOTATIONS)


def _write_composite(folder: Path, index: int, composite: Composite) -> dict[str, Any]:
    """Writes the image and the mask of a composite; returns its entry in the annotations."""
    import cv2

    names = {part: f"{part}/{index:06d}.png" for part in ("images", "masks")}
    for name, pixels in ((names["images"], composite.image[..., ::-1]), (names["masks"], composite.mask)):
        if not cv2.imwrite(str(folder / name), pixels):
            raise OutputError(f"{folder / name}: cannot be written, expected a writable place")
    height, width = composite.image.shape[:2]
    return {
        "id": index + 1,
        "file_name": names["images"],
        "width": width,
        "height": height,
        "background": composite.background,
        "mask_file": names["masks"],
    }


def is_complete(folder: Path, provenance: str) -> bool:
    """Whether a folder holds a complete data set of the given provenance."""
    try:
        return bool(read_json(folder / ANNOTATIONS, FileKind.ANNOTATIONS)["info"]["made"] == provenance)
    except (RpojaxError, KeyError, TypeError):
        return False


def _annotation(number: int, image: int, box: np.ndarray, known: np.ndarray, craft: str) -> dict[str, Any]:
    left, top, right, bottom = (round(float(edge), 3) for edge in box)
    sides = [round(right - left, 3), round(bottom - top, 3)]
    return {
        "id": number,
        "image_id": image,
        "category_id": 1,
        "bbox": [left, top, *sides],
        "area": round(sides[0] * sides[1], 3),
        "iscrowd": 0,
        "craft": craft,
        "known_edges": [bool(edge) for edge in known],
    }


def summary(folder: Path) -> dict[str, int]:
    """Numbers of images, of those without a spacecraft, and of boxes."""
    boxes = _parse(folder / ANNOTATIONS)[1]
    return {
        "images": len(boxes),
        "empty": sum(len(found) == 0 for found in boxes),
        "boxes": sum(len(found) for found in boxes),
    }


def read_dataset(folder: Path, size_px: int = SIZE_PX, limit: int | None = None) -> DetectionDataset:
    """Data set of a folder with `annotations.json` in COCO format; images are resized and padded to squares.

    With `limit` only so many images are read. What is unlikely about the boxes is in `notes`, and each note is a
    `Notice`. Raises `DatasetError` if the folder, its annotations or an image cannot be used.
    """
    path = folder / ANNOTATIONS
    images, boxes, known, outlines = _parse(path)
    sizes = [(entry["width"], entry["height"]) for entry in images]
    notes = noticed(path, (*implausible_boxes(boxes, sizes), *outlines_elsewhere(*outlines)))
    images, boxes, known = images[:limit], boxes[:limit], known[:limit]
    arrays, scaled, masks = [], [], []
    for entry, found in zip(images, boxes, strict=True):
        place = _inside(folder, entry["file_name"])
        picture = read_square_picture(place, size_px, (entry["width"], entry["height"]))
        arrays.append(picture.codes)
        scaled.append((found * picture.scale).astype(np.float32))
        if "mask_file" in entry:
            place = _inside(folder, str(entry["mask_file"]))
            masks.append(read_square_picture(place, size_px, (entry["width"], entry["height"])).codes[..., 0])
    backgrounds = tuple(str(entry.get("background", "unknown")) for entry in images)
    craft = tuple("target" if entry.get("craft") == PACKAGED_TARGET else "other" for entry in images)
    covered = np.stack(masks) if len(masks) == len(images) else None
    codes = np.stack(arrays)
    notes = (*notes, *noticed(path, dark_boxes(codes, scaled)))
    return DetectionDataset(codes, tuple(scaled), backgrounds, craft, tuple(known), covered, notes)


def noticed(place: Path, sentences: Iterable[str]) -> tuple[str, ...]:
    """What is unlikely about a data set, each sentence with its place, and told to the user as a `Notice`."""
    notes = tuple(f"{place}: {sentence}" for sentence in sentences)
    for note in notes:
        warnings.warn(f"warning: {note}", Notice, stacklevel=3)
    return notes


_Parsed = tuple[list[dict[str, Any]], list[np.ndarray], list[np.ndarray], tuple[np.ndarray, np.ndarray]]


def _parse(path: Path) -> _Parsed:
    """Entries of the images of an annotations file, their boxes (n, 4), and which edges (n, 4) are known.

    Last are the boxes (k, 4) that have an outline of polygons, and the boxes (k, 4) around these.
    """
    try:
        content = read_json(path, FileKind.ANNOTATIONS)
    except RpojaxError as error:
        reason = error.found if isinstance(error, FileError) else str(error)
        raise DatasetError(f"{path}: cannot be read ({reason}), expected annotations in COCO's format") from None
    try:
        images = [
            {
                **entry,
                "file_name": str(entry["file_name"]),
                "width": int(entry["width"]),
                "height": int(entry["height"]),
            }
            for entry in content["images"]
        ]
        by_image: dict[Any, list[list[float]]] = {entry["id"]: [] for entry in images}
        known: dict[Any, list[list[bool]]] = {entry["id"]: [] for entry in images}
        outlined: list[tuple[list[float], list[float]]] = []
        by_number = {entry["id"]: entry for entry in images}
        if len(by_number) < len(images):
            counted = Counter(entry["id"] for entry in images)
            raise ValueError(f"two images of id {next(number for number, times in counted.items() if times > 1)}")
        files = Counter(entry["file_name"] for entry in images)
        if len(files) < len(images):
            raise ValueError(f"two images of the file {next(name for name, times in files.items() if times > 1)}")
        kinds = {note.get("category_id") for note in content["annotations"]}
        if len(kinds) > 1:
            raise ValueError(f"categories {sorted(map(str, kinds))}, of which one is meant to be a spacecraft")
        listed = {entry.get("id") for entry in content.get("categories", [])}
        if listed and (unlisted := kinds - listed - {None}):
            raise ValueError(f"category {min(map(str, unlisted))}, which is not listed")
        for note in content["annotations"]:
            if note["image_id"] not in by_number:
                raise ValueError(f"an annotation of image {note['image_id']}, which is not listed")
            if note.get("iscrowd") or note.get("ignore"):
                what = "a crowd" if note.get("iscrowd") else "a box to ignore"
                raise ValueError(f"{what} in image {note['image_id']}, where each spacecraft has its box")
            if note.get("bbox_mode", _LEFT_TOP_SIZES) != _LEFT_TOP_SIZES:
                raise ValueError(f"bbox_mode {note['bbox_mode']!r:.20}, where left, top, width and height are meant")
            left, top, width, height = _box(note["bbox"], by_number[note["image_id"]])
            box = [left, top, left + width, top + height]
            by_image[note["image_id"]].append(box)
            if (around := _around_outline(note.get("segmentation"))) is not None:
                outlined.append((box, around))
            known[note["image_id"]].append(_four_flags(note.get("known_edges", [True] * 4)))
            by_number[note["image_id"]]["craft"] = note.get("craft")
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise DatasetError(f"{path}: found a fault at {error}, expected images and annotations as in COCO") from None
    if not images:
        raise DatasetError(f"{path}: found no images, expected at least one")
    boxes = [np.array(by_image[entry["id"]]).reshape(-1, 4) for entry in images]
    pairs = np.array(outlined, dtype=float).reshape(-1, 2, 4)
    flags = [np.array(known[entry["id"]], bool).reshape(-1, 4) for entry in images]
    return images, boxes, flags, (pairs[:, 0], pairs[:, 1])


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
        ValueError: they are not four.
    """
    if not (isinstance(values, list) and len(values) == 4):
        raise ValueError(f"known_edges {values!r}, expected four flags")
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


def _inside(folder: Path, name: str) -> Path:
    """Path of an image in a data set.

    Raises:
        DatasetError: it leads out of the folder.
    """
    place = absolute_path(folder / name)
    if Path(name).is_absolute() or not place.is_relative_to(absolute_path(folder)):
        raise DatasetError(f"{folder / ANNOTATIONS}: found file_name {name!r}, expected a path inside the data set")
    return folder / name


@dataclasses.dataclass(frozen=True)
class SquarePicture:
    """A picture resized and padded to a square.

    Attributes:
        codes: (p, p, 3) 8 bit sRGB codes
        scale: of lengths in the square over those in the file
        width, height: of the file [px]
    """

    codes: np.ndarray
    scale: float
    width: int
    height: int


def read_square_picture(path: Path, size_px: int, declared: tuple[int, int] | None = None) -> SquarePicture:
    """Picture of a file as a square of `size_px`; with `declared` it must have that width and height.

    Raises:
        DatasetError: it is no such picture.
    """
    import cv2

    try:
        content = read_bytes(path, FileKind.PICTURE)
        check_size(path, content)
        turned = orientation(content)
        found = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    except (RpojaxError, cv2.error) as error:
        reason = str(error) if isinstance(error, RpojaxError) else "it cannot be decoded"
        raise DatasetError(f"{path}: cannot be read ({reason}), expected an image that the annotations name") from None
    if found is None:
        raise DatasetError(f"{path}: cannot be read, expected an image that the annotations name")
    if turned != UPRIGHT:
        raise DatasetError(
            f"{path}: found a picture that its EXIF orientation {turned} turns, expected one as it is stored, since "
            "boxes may be of either"
        )
    height, width = found.shape[:2]
    if declared is not None and (width, height) != declared:
        raise DatasetError(f"{path}: found {width} x {height} px, expected {declared[0]} x {declared[1]}")
    scale = size_px / max(width, height)
    if scale != 1.0:
        sides = max(1, round(width * scale)), max(1, round(height * scale))
        found = cv2.resize(found, sides, interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR)
    square = np.zeros((size_px, size_px, 3), np.uint8)
    square[: found.shape[0], : found.shape[1]] = found[..., ::-1]
    return SquarePicture(square, scale, width, height)


def draw_boxes(images: np.ndarray, boxes: "tuple[np.ndarray, ...] | list[np.ndarray]", columns: int = 12) -> np.ndarray:
    """Images (n, p, p, 3) of 8 bit codes side by side with their boxes, three times enlarged (BGR)."""
    import cv2

    factor, size = 3, images.shape[1]
    rows = -(-len(images) // columns)
    sheet = np.zeros((rows * size * factor, min(columns, len(images)) * size * factor, 3), np.uint8)
    for index, (image, found) in enumerate(zip(images, boxes, strict=True)):
        large = np.repeat(np.repeat(image[..., ::-1], factor, axis=0), factor, axis=1)
        for box in found:
            left, top, right, bottom = (round(factor * float(edge)) for edge in box[:4])
            cv2.rectangle(large := np.ascontiguousarray(large), (left, top), (right, bottom), (0, 255, 0), 1)
        row, column = divmod(index, columns)
        place = np.s_[
            row * size * factor : (row + 1) * size * factor, column * size * factor : (column + 1) * size * factor
        ]
        sheet[place] = large
    return sheet
