"""Geometric augmentation of images with boxes: flips, zooms, mosaics and crops."""

import dataclasses

import cv2
import numpy as np

from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

Rng = np.random.Generator

_MIN_VISIBLE_FRACTION = 0.4


@dataclasses.dataclass(frozen=True)
class LabelledImage:
    """An image with its boxes.

    Attributes:
        pixels: (p, p, 4) 8 bit codes of colour, and the covered fraction 0..255
        boxes: (n, 4) left, top, right, bottom [px]
        weight: (n,) 1 for a box to learn, -1 for one to ignore
        known: (n, 4) whether the image shows each edge
        has_mask: whether the covered fraction is known
    """

    pixels: np.ndarray
    boxes: np.ndarray
    weight: np.ndarray
    known: np.ndarray
    has_mask: bool

    @property
    def codes(self) -> np.ndarray:
        """Colour (p, p, 3) in 8 bits."""
        return self.pixels[..., :3]

    @property
    def coverage(self) -> np.ndarray:
        """Covered fraction (p, p) in 0..1, or -1 if it is not known."""
        fraction = self.pixels[..., 3].astype(np.float32) / np.float32(255.0)
        return fraction if self.has_mask else np.full_like(fraction, -1.0)


def labelled_image(data: DetectionDataset, index: int) -> LabelledImage:
    """An image of a data set as it is."""
    codes, boxes = data.images[index], data.boxes[index].astype(np.float32)
    mask = np.zeros(codes.shape[:2], np.uint8) if data.masks is None else data.masks[index]
    pixels = np.concatenate([codes, mask[..., None]], axis=2)
    weight = np.ones(len(boxes), np.float32)
    return LabelledImage(pixels, boxes, weight, data.known_edges(index), data.masks is not None)


def augment_geometry(rng: Rng, data: DetectionDataset, index: int) -> LabelledImage:
    """An image of a data set flipped, zoomed or in a mosaic."""
    if rng.random() < 0.1:
        others = rng.integers(0, len(data), 3)
        return _mosaic([_random_flip(rng, labelled_image(data, int(i))) for i in (index, *others)])
    view = _random_flip(rng, labelled_image(data, index))
    return _random_zoom(rng, view) if rng.random() < 0.4 else view


def _random_flip(rng: Rng, view: LabelledImage) -> LabelledImage:
    """An image in one of the eight orientations of a square."""
    pixels, size = view.pixels, view.pixels.shape[1]
    left, top, right, bottom = view.boxes.T
    order = np.arange(4)
    if rng.random() < 0.5:
        pixels = pixels[:, ::-1]
        left, right = size - right, size - left
        order = order[[2, 1, 0, 3]]
    if rng.random() < 0.5:
        pixels = pixels[::-1]
        top, bottom = size - bottom, size - top
        order = order[[0, 3, 2, 1]]
    if rng.random() < 0.5:
        pixels = pixels.transpose(1, 0, 2)
        left, top, right, bottom = top, left, bottom, right
        order = order[[1, 0, 3, 2]]
    boxes = np.stack([left, top, right, bottom], axis=1)
    return dataclasses.replace(view, pixels=np.ascontiguousarray(pixels), boxes=boxes, known=view.known[:, order])


def _random_zoom(rng: Rng, view: LabelledImage) -> LabelledImage:
    """A smaller window, enlarged to the size of the image."""
    size = view.pixels.shape[0]
    zoom = float(np.exp(rng.uniform(0.0, np.log(1.9))))
    corner = rng.uniform(0.0, size - size / zoom, 2)
    shift = -corner * zoom + 0.5 * zoom - 0.5
    matrix = np.array([[zoom, 0.0, shift[0]], [0.0, zoom, shift[1]]])
    flags = cv2.INTER_LINEAR if rng.random() < 0.5 else cv2.INTER_CUBIC
    taken = cv2.warpAffine(view.pixels, matrix, (size, size), flags=flags, borderMode=cv2.BORDER_REFLECT)
    return _in_window(dataclasses.replace(view, pixels=np.asarray(taken)), corner, zoom, size)


def _in_window(view: LabelledImage, corner: np.ndarray, zoom: float, size: int) -> LabelledImage:
    """Boxes clipped to an enlarged window; those mostly outside of it get the weight -1, cut edges are known."""
    moved = (view.boxes - np.tile(corner, 2)) * zoom
    clipped = np.clip(moved, 0.0, size)
    whole_area, visible_area = (np.prod(np.maximum(b[:, 2:] - b[:, :2], 0.0), axis=1) for b in (moved, clipped))
    weight = np.where(visible_area < _MIN_VISIBLE_FRACTION * whole_area, -1.0, view.weight)
    kept = visible_area > 0.0
    known = view.known | (clipped != moved)
    return dataclasses.replace(view, boxes=clipped[kept], weight=weight[kept], known=known[kept])


def _mosaic(parts: list[LabelledImage]) -> LabelledImage:
    """Four images at half size side by side."""
    half = parts[0].pixels.shape[0] // 2
    mosaic, small = np.empty_like(parts[0].pixels), [_half_size(part) for part in parts]
    corners = ((0, 0), (0, half), (half, 0), (half, half))
    for (top, left), view in zip(corners, small, strict=True):
        mosaic[top : top + half, left : left + half] = view.pixels
    boxes = [view.boxes + np.array([left, top, left, top]) for (top, left), view in zip(corners, small, strict=True)]
    weight, known = (np.concatenate([getattr(view, name) for view in small]) for name in ("weight", "known"))
    return LabelledImage(mosaic, np.concatenate(boxes), weight, known, all(view.has_mask for view in small))


def _half_size(view: LabelledImage) -> LabelledImage:
    half = view.pixels.shape[0] // 2
    small = np.asarray(cv2.resize(view.pixels, (half, half), interpolation=cv2.INTER_AREA))
    return dataclasses.replace(view, pixels=small, boxes=0.5 * view.boxes)


def two_crops(rng: Rng, view: LabelledImage) -> list[LabelledImage]:
    """The whole image at half its side, and a window of that side, mostly around a spacecraft."""
    half = view.pixels.shape[0] // 2
    corner = rng.integers(0, half + 1, 2)
    if len(view.boxes) and rng.random() < 0.8:
        box = view.boxes[int(rng.integers(len(view.boxes)))]
        aim = 0.5 * (box[:2] + box[2:]) - half * rng.uniform(0.15, 0.85, 2)
        corner = np.clip(np.round(aim), 0, half).astype(int)
    crop = view.pixels[corner[1] : corner[1] + half, corner[0] : corner[0] + half]
    return [_half_size(view), _in_window(dataclasses.replace(view, pixels=crop), corner, 1.0, half)]
