"""Data sets of images with the boxes of spacecraft, in memory and in folders in COCO format."""

import dataclasses
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rpojax.errors import OutputError, RpojaxError
from rpojax.training.labelled_pictures.box_plausibility import (
    implausible_boxes,
    implausible_pictures,
    masks_elsewhere,
    outlines_elsewhere,
)
from rpojax.training.labelled_pictures.coco_annotations import CATEGORY, read_annotations
from rpojax.training.labelled_pictures.dataset_faults import DatasetError, noticed
from rpojax.training.labelled_pictures.square_pictures import read_pictures, read_square_picture
from rpojax.training.synthetic_data.composites import GENERATORS, SIZE_PX, Composite, CompositeMix, random_composite
from rpojax.training.synthetic_data.meshes.packaged_target import PACKAGED_TARGET
from rpojax.training.synthetic_data.scenery.earth_views import EarthTextures
from rpojax.training.synthetic_data.spacecraft_sprites import Sprite
from rpojax.untrusted.file_reading import FileKind, absolute_path
from rpojax.untrusted.json_reading import read_json

ANNOTATIONS = "annotations.json"


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
        sizes: (n, 2) width and height [px] of the files; without it those of the images
    """

    images: np.ndarray
    boxes: tuple[np.ndarray, ...]
    backgrounds: tuple[str, ...]
    craft: tuple[str, ...] = ()
    known: tuple[np.ndarray, ...] = ()
    masks: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    sizes: np.ndarray | None = None

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
            self.file_sizes()[indices],
        )

    def known_edges(self, index: int) -> np.ndarray:
        """Whether an image shows each edge (m, 4) of its boxes."""
        return self.known[index] if self.known else np.ones((len(self.boxes[index]), 4), bool)

    def file_sizes(self) -> np.ndarray:
        """Width and height (n, 2) [px] of the files."""
        return np.full((len(self), 2), self.images.shape[1]) if self.sizes is None else self.sizes


def concatenate(datasets: list[DetectionDataset]) -> DetectionDataset:
    """One data set of several; without masks unless all parts have them."""
    first, *others = datasets
    if not others:
        return first
    masks = [part.masks for part in datasets if part.masks is not None]
    some = f"{len(masks)} of {len(datasets)} have masks, which are not used without those of the others"
    notes = noticed("data sets", [some] if 0 < len(masks) < len(datasets) else [])
    return DetectionDataset(
        np.concatenate([part.images for part in datasets]),
        tuple(box for part in datasets for box in part.boxes),
        tuple(background for part in datasets for background in part.backgrounds),
        tuple(name for part in datasets for name in part.craft or ("other",) * len(part)),
        tuple(part.known_edges(index) for part in datasets for index in range(len(part))),
        np.concatenate(masks) if len(masks) == len(datasets) else None,
        (*(note for part in datasets for note in part.notes), *notes),
        np.concatenate([part.file_sizes() for part in datasets]),
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
    boxes = read_annotations(folder / ANNOTATIONS).boxes
    return {
        "images": len(boxes),
        "empty": sum(len(found) == 0 for found in boxes),
        "boxes": sum(len(found) for found in boxes),
    }


def read_dataset(folder: Path, size_px: int = SIZE_PX, limit: int | None = None) -> DetectionDataset:
    """Data set of a folder with `annotations.json` in COCO format; images are resized and padded to squares.

    At most `limit` images are read. `notes` say what is unlikely about the boxes, and each note is a `Notice`. Raises
    `DatasetError` if the folder, its annotations or an image cannot be used.
    """
    path = folder / ANNOTATIONS
    listed = read_annotations(path)
    images, boxes = listed.images[:limit], listed.boxes[:limit]
    places = [_inside(folder, entry["file_name"]) for entry in images]
    pictures = read_pictures(places, size_px, listed.sizes[:limit], path)
    scaled = tuple((found * scale).astype(np.float32) for found, scale in zip(boxes, pictures.scales, strict=True))
    masks = _read_masks(folder, images, size_px)
    without = sum("mask_file" not in entry for entry in images)
    some = f"{without} of {len(images)} images have no mask_file: masks are not used without it"
    sentences = (
        *listed.notes,
        *implausible_boxes(listed.boxes, listed.sizes),
        *outlines_elsewhere(listed.outlined, listed.outlines),
        *implausible_pictures(pictures.codes, scaled, pictures.bits),
        *([some] if 0 < without < len(images) else []),
        *(() if masks is None else masks_elsewhere(scaled, masks, pictures.sizes * pictures.scales[:, None])),
    )
    return DetectionDataset(
        pictures.codes,
        scaled,
        tuple(str(entry.get("background", "unknown")) for entry in images),
        tuple("target" if entry.get("craft") == PACKAGED_TARGET else "other" for entry in images),
        tuple(listed.known[:limit]),
        masks,
        noticed(path, sentences),
        pictures.sizes,
    )


def _read_masks(folder: Path, images: Sequence[dict[str, Any]], size_px: int) -> np.ndarray | None:
    """Masks (n, p, p) of images, if all have one."""
    if not all("mask_file" in entry for entry in images):
        return None
    masks = np.zeros((len(images), size_px, size_px), np.uint8)
    for index, entry in enumerate(images):
        place = _inside(folder, str(entry["mask_file"]))
        masks[index] = read_square_picture(place, size_px, (entry["width"], entry["height"])).codes[..., 0]
    return masks


def _inside(folder: Path, name: str) -> Path:
    """Path of an image in a data set.

    Raises:
        DatasetError: it leads out of the folder.
    """
    place = absolute_path(folder / name)
    if Path(name).is_absolute() or not place.is_relative_to(absolute_path(folder)):
        raise DatasetError(f"{folder / ANNOTATIONS}: found file_name {name!r}, expected a path inside the data set")
    return folder / name


def draw_boxes(images: np.ndarray, boxes: tuple[np.ndarray, ...] | list[np.ndarray], columns: int = 12) -> np.ndarray:
    """Images (n, p, p, 3) of 8 bit codes side by side with their boxes, three times enlarged (BGR)."""
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
