"""Geometric augmentation of images with boxes: flips, zooms, mosaics and crops.

Boxes (n, 5) are left, top, right, bottom [px], and a weight as in `augmentation.Batch`.
"""

import numpy as np

from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

Rng = np.random.Generator

_MIN_VISIBLE_FRACTION = 0.4


def augment_geometry(rng: Rng, data: DetectionDataset, index: int) -> tuple[np.ndarray, np.ndarray]:
    """An image of a data set flipped, zoomed or in a mosaic, and its boxes."""
    if rng.random() < 0.1:
        others = rng.integers(0, len(data), 3)
        return _mosaic([_random_flip(rng, data, int(i)) for i in (index, *others)])
    image, boxes = _random_flip(rng, data, index)
    return _random_zoom(rng, image, boxes) if rng.random() < 0.4 else (image, boxes)


def _random_flip(rng: Rng, data: DetectionDataset, index: int) -> tuple[np.ndarray, np.ndarray]:
    """An image in one of the eight orientations of a square."""
    image, size = data.images[index], data.images.shape[1]
    left, top, right, bottom = data.boxes[index].T
    if rng.random() < 0.5:
        image = image[:, ::-1]
        left, right = size - right, size - left
    if rng.random() < 0.5:
        image = image[::-1]
        top, bottom = size - bottom, size - top
    if rng.random() < 0.5:
        image = image.transpose(1, 0, 2)
        left, top, right, bottom = top, left, bottom, right
    return np.ascontiguousarray(image), np.stack([left, top, right, bottom, np.ones_like(left)], axis=1)


def _random_zoom(rng: Rng, image: np.ndarray, boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A smaller window, enlarged to the size of the image."""
    import cv2

    size = image.shape[0]
    zoom = float(np.exp(rng.uniform(0.0, np.log(1.9))))
    corner = rng.uniform(0.0, size - size / zoom, 2)
    shift = -corner * zoom + 0.5 * zoom - 0.5
    matrix = np.array([[zoom, 0.0, shift[0]], [0.0, zoom, shift[1]]])
    flags = cv2.INTER_LINEAR if rng.random() < 0.5 else cv2.INTER_CUBIC
    taken = cv2.warpAffine(image, matrix, (size, size), flags=flags, borderMode=cv2.BORDER_REFLECT)
    return np.asarray(taken), _clip_to_window(boxes, corner, zoom, size)


def _clip_to_window(boxes: np.ndarray, corner: np.ndarray, zoom: float, size: int) -> np.ndarray:
    """Boxes clipped to an enlarged window; those mostly outside of it get the weight -1."""
    moved = (boxes[:, :4] - np.tile(corner, 2)) * zoom
    clipped = np.clip(moved, 0.0, size)
    whole_area, visible_area = (np.prod(np.maximum(b[:, 2:] - b[:, :2], 0.0), axis=1) for b in (moved, clipped))
    weight = np.where(visible_area < _MIN_VISIBLE_FRACTION * whole_area, -1.0, boxes[:, 4])
    return np.column_stack([clipped, weight])[visible_area > 0.0]


def _mosaic(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Four images at half size side by side."""
    half = parts[0][0].shape[0] // 2
    mosaic, boxes = np.empty_like(parts[0][0]), []
    for (top, left), (image, found) in zip(((0, 0), (0, half), (half, 0), (half, half)), parts, strict=True):
        small, moved = _half_size(image, found)
        mosaic[top : top + half, left : left + half] = small
        boxes.append(moved + np.array([left, top, left, top, 0.0]))
    return mosaic, np.concatenate(boxes)


def _half_size(image: np.ndarray, boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    import cv2

    half = image.shape[0] // 2
    small = np.asarray(cv2.resize(image, (half, half), interpolation=cv2.INTER_AREA))
    return small, boxes * np.array([0.5, 0.5, 0.5, 0.5, 1.0])


def two_crops(rng: Rng, image: np.ndarray, boxes: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The whole image at half its side, and a window of that side, mostly around a spacecraft."""
    half = image.shape[0] // 2
    corner = rng.integers(0, half + 1, 2)
    if len(boxes) and rng.random() < 0.8:
        box = boxes[int(rng.integers(len(boxes)))]
        aim = 0.5 * (box[:2] + box[2:4]) - half * rng.uniform(0.15, 0.85, 2)
        corner = np.clip(np.round(aim), 0, half).astype(int)
    crop = image[corner[1] : corner[1] + half, corner[0] : corner[0] + half]
    return [_half_size(image, boxes), (crop, _clip_to_window(boxes, corner, 1.0, half))]
