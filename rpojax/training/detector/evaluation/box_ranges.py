"""Ranges of boxes that count in an evaluation: by apparent size, and by contrast to the surroundings."""

from collections.abc import Callable

import numpy as np

_RING_FRACTION = 0.25
_MIN_RING_PX = 2

IsOutside = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Flags (n,) of boxes (n, 4) in an image (p, p, 3)."""


def outside_size_range(min_px: float, max_px: float = np.inf) -> IsOutside:
    """Flags boxes whose long side is below `min_px`, or `max_px` or more."""

    def is_outside(image: np.ndarray, boxes: np.ndarray) -> np.ndarray:
        del image
        side = long_side(boxes)
        return (side < min_px) | (side >= max_px)

    return is_outside


def outside_contrast_range(least: float, most: float, min_px: float = 16.0) -> IsOutside:
    """Flags boxes whose contrast is outside of a range, or whose long side is below `min_px`."""

    def is_outside(image: np.ndarray, boxes: np.ndarray) -> np.ndarray:
        contrast = np.array([box_contrast(image, box) for box in boxes])
        return (long_side(boxes) < min_px) | (contrast < least) | (contrast >= most)

    return is_outside


def long_side(boxes: np.ndarray) -> np.ndarray:
    """Longer side (n,) [px] of boxes (n, 4)."""
    return np.max(boxes[:, 2:] - boxes[:, :2], axis=1, initial=0.0) if len(boxes) else np.zeros(0)


def box_contrast(image: np.ndarray, box: np.ndarray) -> float:
    """Largest difference over the colours between the mean codes in a box and in a ring around it."""
    height, width = image.shape[:2]
    ring = np.maximum(_MIN_RING_PX, np.round(_RING_FRACTION * (box[2:] - box[:2]))).astype(int)
    left, top = np.floor(box[:2]).astype(int)
    right, bottom = np.ceil(box[2:]).astype(int)
    rows = np.clip([top - ring[1], bottom + ring[1]], 0, height)
    columns = np.clip([left - ring[0], right + ring[0]], 0, width)
    inner = image[max(top, 0) : bottom, max(left, 0) : right].reshape(-1, 3).astype(float)
    outer = image[rows[0] : rows[1], columns[0] : columns[1]].reshape(-1, 3).astype(float)
    ring_count = len(outer) - len(inner)
    if len(inner) == 0 or ring_count <= 0:
        return 0.0
    around = (outer.sum(axis=0) - inner.sum(axis=0)) / ring_count
    return float(np.abs(inner.mean(axis=0) - around).max())
