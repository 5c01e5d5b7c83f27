"""What training does to a picture before the network sees it: other places, sizes, exposures and faults of a camera."""

import dataclasses

import numpy as np

from rpojax.training.detection_data import Dataset

Rng = np.random.Generator

MOST_BOXES = 8
_LEAST_PX = 4.0
_KEPT_AREA = 0.4
_NOISE_SIDE = 512


@dataclasses.dataclass(frozen=True)
class Batch:
    """Pictures ready for the network.

    Attributes:
        images: (n, p, p, 3) float32 sRGB codes in 0..1
        boxes: (n, MOST_BOXES, 4) float32 left, top, right, bottom [px]
        weight: (n, MOST_BOXES) 1 for a box to learn, 0 for none, -1 for one that is neither right nor wrong
    """

    images: np.ndarray
    boxes: np.ndarray
    weight: np.ndarray


def batch(data: Dataset, chosen: np.ndarray, rng: Rng) -> Batch:
    """The pictures of some numbers, each changed at random."""
    noise = rng.normal(size=(_NOISE_SIDE, _NOISE_SIDE, 3)).astype(np.float32)
    images, boxes, weights = [], [], []
    for index in chosen:
        image, found = _geometry(rng, data, int(index))
        images.append(_look(rng, image, noise))
        box, weight = _padded(found)
        boxes.append(box)
        weights.append(weight)
    return Batch(np.stack(images), np.stack(boxes), np.stack(weights))


def _padded(found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest boxes first, in arrays of fixed length."""
    sides = found[:, 2:] - found[:, :2]
    order = np.argsort(-sides.max(axis=1, initial=0.0) if len(sides) else np.zeros(0))[:MOST_BOXES]
    box, weight = np.zeros((MOST_BOXES, 4), np.float32), np.zeros(MOST_BOXES, np.float32)
    box[: len(order)] = found[order]
    weight[: len(order)] = np.where(sides[order].max(axis=1, initial=0.0) >= _LEAST_PX, 1.0, -1.0)
    return box, weight


# Where things are.


def _geometry(rng: Rng, data: Dataset, index: int) -> tuple[np.ndarray, np.ndarray]:
    if rng.random() < 0.1:
        others = rng.integers(0, len(data), 3)
        return _mosaic(rng, [_turned(rng, data.images[i], data.boxes[i]) for i in (index, *others)])
    image, boxes = _turned(rng, data.images[index], data.boxes[index])
    return _cut(rng, image, boxes) if rng.random() < 0.4 else (image, boxes)


def _turned(rng: Rng, image: np.ndarray, boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One of the eight ways to turn and mirror a square."""
    size = image.shape[0]
    left, top, right, bottom = boxes.T
    if rng.random() < 0.5:
        image = image[:, ::-1]
        left, right = size - right, size - left
    if rng.random() < 0.5:
        image = image[::-1]
        top, bottom = size - bottom, size - top
    if rng.random() < 0.5:
        image = image.transpose(1, 0, 2)
        left, top, right, bottom = top, left, bottom, right
    return image, np.stack([left, top, right, bottom], axis=1)


def _cut(rng: Rng, image: np.ndarray, boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A smaller window, enlarged; where it would leave only a scrap of a spacecraft, the whole picture."""
    import cv2

    size = image.shape[0]
    zoom = float(np.exp(rng.uniform(0.0, np.log(1.9))))
    window = size / zoom
    corner = rng.uniform(0.0, size - window, 2)
    moved = (boxes - np.tile(corner, 2)) * zoom
    clipped = np.clip(moved, 0.0, size)
    whole, left = _areas(moved), _areas(clipped)
    inside = left > 0.0
    if (left[inside] < _KEPT_AREA * whole[inside]).any():
        return image, boxes
    shift = -corner * zoom + 0.5 * zoom - 0.5
    matrix = np.array([[zoom, 0.0, shift[0]], [0.0, zoom, shift[1]]])
    flags = cv2.INTER_LINEAR if rng.random() < 0.5 else cv2.INTER_CUBIC
    taken = cv2.warpAffine(
        np.ascontiguousarray(image), matrix, (size, size), flags=flags, borderMode=cv2.BORDER_REFLECT
    )
    return np.asarray(taken), clipped[inside]


def _areas(boxes: np.ndarray) -> np.ndarray:
    return np.prod(np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0), axis=1)


def _mosaic(rng: Rng, parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Four pictures at half size side by side."""
    import cv2

    size = parts[0][0].shape[0]
    half = size // 2
    picture, boxes = np.empty_like(parts[0][0]), []
    for place, (image, found) in zip(((0, 0), (0, half), (half, 0), (half, half)), parts, strict=True):
        small = cv2.resize(np.ascontiguousarray(image), (half, half), interpolation=cv2.INTER_AREA)
        picture[place[0] : place[0] + half, place[1] : place[1] + half] = small
        boxes.append(0.5 * found + np.tile(place[::-1], 2))
    return picture, np.concatenate(boxes)


# How things look.


def _look(rng: Rng, image: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Codes (p, p, 3) in 0..1 float32 after changes of tone, glare, blur, noise and colour, each now and then."""
    import cv2

    values = np.ascontiguousarray(image).astype(np.float32) / np.float32(255.0)
    if rng.random() < 0.5:
        values = _toned(rng, values)
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
        values = values + np.float32(np.exp(rng.uniform(np.log(0.004), np.log(0.05)))) * _piece(
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


def _toned(rng: Rng, values: np.ndarray) -> np.ndarray:
    """Another exposure, contrast curve and balance of colours."""
    gain = np.float32(np.exp(rng.normal(scale=0.35)))
    tint = (1.0 + rng.normal(scale=0.06, size=3)).astype(np.float32)
    offset = np.float32(max(0.0, rng.normal(scale=0.02)))
    return np.clip(gain * tint * values, 0.0, 2.0) ** np.float32(np.exp(rng.normal(scale=0.2))) + offset


def _glare(rng: Rng, size: int) -> np.ndarray:
    """Light of a Sun in or near the frame."""
    y, x = np.mgrid[:size, :size].astype(np.float32)
    middle = rng.uniform(-0.3, 1.3, 2).astype(np.float32) * size
    distance = np.hypot(x - middle[0], y - middle[1]) / np.float32(size)
    light = np.float32(rng.uniform(0.05, 0.5)) * np.exp(-distance / np.float32(rng.uniform(0.05, 0.5)))
    return light[..., None] * rng.uniform(0.7, 1.0, 3).astype(np.float32)


def _piece(rng: Rng, noise: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    row, column = rng.integers(0, _NOISE_SIDE - shape[0], 2)
    return noise[row : row + shape[0], column : column + shape[1]]
