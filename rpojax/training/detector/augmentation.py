"""Batches of augmented training images with boxes."""

import dataclasses
from typing import Any

import cv2
import numpy as np

from rpojax.core.pytree import pytree
from rpojax.training.detector.average_precision import long_side
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

Rng = np.random.Generator

_MIN_VISIBLE_FRACTION = 0.4
NOISE_SIDE_PX = 512
"""Side of the square of standard normal numbers from which noise is cropped."""
MAX_BOXES = 8
_MIN_SIDE_PX = 4.0


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
    """Boxes clipped to an enlarged window; boxes mostly outside of it get the weight -1, cut edges are known."""
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


def augment_appearance(rng: Rng, image: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Codes (p, p, 3) in 0..1 float32 after random changes of tone, glare, blur, noise, colour and compression."""
    values = np.ascontiguousarray(image).astype(np.float32) / np.float32(255.0)
    if rng.random() < 0.5:
        values = _random_tone(rng, values)
    if rng.random() < 0.08:
        values = values + _glare(rng, values.shape[0])
    if rng.random() < 0.12:
        bright = np.maximum(values - np.float32(rng.uniform(0.4, 0.8)), 0.0)
        values = values + np.float32(rng.uniform(0.3, 1.5)) * cv2.GaussianBlur(bright, (0, 0), rng.uniform(2.0, 8.0))
    if rng.random() < 0.2:
        values = cv2.GaussianBlur(values, (0, 0), float(rng.uniform(0.3, 1.4)))
    if rng.random() < 0.1:
        soft = cv2.GaussianBlur(values, (0, 0), 1.0)
        values = values + np.float32(rng.uniform(0.3, 1.2)) * (values - soft)
    if rng.random() < 0.3:
        values = values + np.float32(np.exp(rng.uniform(np.log(0.004), np.log(0.05)))) * _noise_crop(
            rng, noise, values.shape
        )
    if rng.random() < 0.25:
        values = np.repeat(values @ np.array([[0.299], [0.587], [0.114]], np.float32), 3, axis=2)
    values = np.clip(values, 0.0, 1.0)
    if rng.random() < 0.15:
        quality = int(rng.integers(30, 95))
        packed = cv2.imencode(".jpg", np.round(255.0 * values).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        values = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR)).astype(np.float32) / np.float32(255.0)
    return values.astype(np.float32)


def _random_tone(rng: Rng, values: np.ndarray) -> np.ndarray:
    """Random exposure, contrast curve and colour balance."""
    gain = np.float32(np.exp(rng.normal(scale=0.35)))
    tint = (1.0 + rng.normal(scale=0.06, size=3)).astype(np.float32)
    offset = np.float32(max(0.0, rng.normal(scale=0.02)))
    return np.clip(gain * tint * values, 0.0, 2.0) ** np.float32(np.exp(rng.normal(scale=0.2))) + offset


def _glare(rng: Rng, size: int) -> np.ndarray:
    """Glare of the Sun in or near the frame."""
    y, x = np.mgrid[:size, :size].astype(np.float32)
    center = rng.uniform(-0.3, 1.3, 2).astype(np.float32) * size
    distance = np.hypot(x - center[0], y - center[1]) / np.float32(size)
    light = np.float32(rng.uniform(0.05, 0.5)) * np.exp(-distance / np.float32(rng.uniform(0.05, 0.5)))
    return light[..., None] * rng.uniform(0.7, 1.0, 3).astype(np.float32)


def _noise_crop(rng: Rng, noise: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    row, column = rng.integers(0, NOISE_SIDE_PX - shape[0], 2)
    return noise[row : row + shape[0], column : column + shape[1]]


@pytree
class Batch:
    """Images for one step of a training, in arrays of NumPy on the host and of JAX in the step.

    Attributes:
        images: (n, p, p, 3) float32 sRGB codes in 0..1
        boxes: (n, MAX_BOXES, 4) float32 left, top, right, bottom [px]
        weight: (n, MAX_BOXES) 1 for a box to learn, 0 for none, -1 for one to ignore
        known: (n, MAX_BOXES, 4) 1 for an edge that the image shows, else 0
        mask: (n, p, p) fraction 0..1 of each pixel that visible spacecraft cover, -1 where nobody knows
    """

    images: Any
    boxes: Any
    weight: Any
    known: Any
    mask: Any


def augment_batch(data: DetectionDataset, indices: np.ndarray, rng: Rng, crops: bool = False) -> Batch:
    """Images with the given indices, each augmented at random.

    With `crops` each becomes two of half the side: the whole image, shrunk, and a crop at full resolution.
    """
    noise = rng.normal(size=(NOISE_SIDE_PX, NOISE_SIDE_PX, 3)).astype(np.float32)
    images, labels, masks = [], [], []
    for index in indices:
        view = augment_geometry(rng, data, int(index))
        for part in two_crops(rng, view) if crops else (view,):
            images.append(augment_appearance(rng, part.codes, noise))
            labels.append(_padded_labels(part))
            masks.append(part.coverage)
    boxes, weight, known = (np.stack(arrays) for arrays in zip(*labels, strict=True))
    return Batch(images=np.stack(images), boxes=boxes, weight=weight, known=known, mask=np.stack(masks))


def _padded_labels(view: LabelledImage) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Boxes, weights and known edges in arrays of fixed length, the largest boxes first; tiny ones are ignored."""
    side = long_side(view.boxes)
    order = np.argsort(-side)[:MAX_BOXES]
    box, weight = np.zeros((MAX_BOXES, 4), np.float32), np.zeros(MAX_BOXES, np.float32)
    known = np.zeros((MAX_BOXES, 4), np.float32)
    box[: len(order)], known[: len(order)] = view.boxes[order], view.known[order]
    weight[: len(order)] = np.where(side[order] >= _MIN_SIDE_PX, view.weight[order], -1.0)
    return box, weight, known
