"""What training does to a picture before the network sees it: other places, sizes, exposures and faults of a camera."""

import dataclasses

import numpy as np

from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

Rng = np.random.Generator

MAX_BOXES = 8
_MIN_SIDE_PX = 4.0
_MIN_VISIBLE_FRACTION = 0.4
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


def augment_batch(data: DetectionDataset, indices: np.ndarray, rng: Rng, crops: bool = False) -> Batch:
    """The pictures of some numbers, each changed at random.

    As `pieces` each becomes two of half the side: the whole of it, shrunk, and a part of it as it is.
    """
    noise = rng.normal(size=(_NOISE_SIDE, _NOISE_SIDE, 3)).astype(np.float32)
    images, boxes, weights = [], [], []
    for index in indices:
        image, found = _augment_geometry(rng, data, int(index))
        for piece, inside in _two_crops(rng, image, found) if crops else ((image, found),):
            images.append(_augment_appearance(rng, piece, noise))
            box, weight = _pad_boxes(inside)
            boxes.append(box)
            weights.append(weight)
    return Batch(np.stack(images), np.stack(boxes), np.stack(weights))


def _pad_boxes(found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest boxes first, in arrays of fixed length; a spacecraft of a few pixels is neither right nor wrong."""
    side = np.max(found[:, 2:4] - found[:, :2], axis=1, initial=0.0)
    order = np.argsort(-side)[:MAX_BOXES]
    box, weight = np.zeros((MAX_BOXES, 4), np.float32), np.zeros(MAX_BOXES, np.float32)
    box[: len(order)] = found[order, :4]
    weight[: len(order)] = np.where(side[order] >= _MIN_SIDE_PX, found[order, 4], -1.0)
    return box, weight


# Where things are. Boxes (n, 5) are left, top, right, bottom [px] and the weight that `Batch` describes.


def _augment_geometry(rng: Rng, data: DetectionDataset, index: int) -> tuple[np.ndarray, np.ndarray]:
    if rng.random() < 0.1:
        others = rng.integers(0, len(data), 3)
        return _mosaic([_random_flip(rng, data, int(i)) for i in (index, *others)])
    image, boxes = _random_flip(rng, data, index)
    return _random_zoom(rng, image, boxes) if rng.random() < 0.4 else (image, boxes)


def _random_flip(rng: Rng, data: DetectionDataset, index: int) -> tuple[np.ndarray, np.ndarray]:
    """A picture in one of the eight ways to turn and mirror a square."""
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
    """A smaller window at the size of the whole."""
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
    """Boxes cut to a window, enlarged; a scrap of a spacecraft is neither right nor wrong."""
    moved = (boxes[:, :4] - np.tile(corner, 2)) * zoom
    cut = np.clip(moved, 0.0, size)
    whole, left = (np.prod(np.maximum(b[:, 2:] - b[:, :2], 0.0), axis=1) for b in (moved, cut))
    weight = np.where(left < _MIN_VISIBLE_FRACTION * whole, -1.0, boxes[:, 4])
    return np.column_stack([cut, weight])[left > 0.0]


def _mosaic(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Four pictures at half size side by side."""
    half = parts[0][0].shape[0] // 2
    picture, boxes = np.empty_like(parts[0][0]), []
    for (top, left), (image, found) in zip(((0, 0), (0, half), (half, 0), (half, half)), parts, strict=True):
        small, moved = _half_size(image, found)
        picture[top : top + half, left : left + half] = small
        boxes.append(moved + np.array([left, top, left, top, 0.0]))
    return picture, np.concatenate(boxes)


def _half_size(image: np.ndarray, boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    import cv2

    half = image.shape[0] // 2
    small = np.asarray(cv2.resize(image, (half, half), interpolation=cv2.INTER_AREA))
    return small, boxes * np.array([0.5, 0.5, 0.5, 0.5, 1.0])


def _two_crops(rng: Rng, image: np.ndarray, boxes: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The whole picture at half its side, and a window of that side, mostly around a spacecraft."""
    half = image.shape[0] // 2
    corner = rng.integers(0, half + 1, 2)
    if len(boxes) and rng.random() < 0.8:
        box = boxes[int(rng.integers(len(boxes)))]
        aim = 0.5 * (box[:2] + box[2:4]) - half * rng.uniform(0.15, 0.85, 2)
        corner = np.clip(np.round(aim), 0, half).astype(int)
    part = image[corner[1] : corner[1] + half, corner[0] : corner[0] + half]
    return [_half_size(image, boxes), (part, _clip_to_window(boxes, corner, 1.0, half))]


# How things look.


def _augment_appearance(rng: Rng, image: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Codes (p, p, 3) in 0..1 float32 after changes of tone, glare, blur, noise and colour, each now and then."""
    import cv2

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


def _noise_crop(rng: Rng, noise: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    row, column = rng.integers(0, _NOISE_SIDE - shape[0], 2)
    return noise[row : row + shape[0], column : column + shape[1]]
