"""Intersection over union of boxes: of two, of all pairs, and generalised.

Boxes (..., 4) are left, top, right, bottom [px], in arrays of NumPy or of JAX that broadcast against each other.
"""

from typing import TypeVar

import jax
import numpy as np

Boxes = TypeVar("Boxes", np.ndarray, jax.Array)

_MIN_AREA = 1e-6
"""Least divisor [px^2], against the division of nothing by nothing."""


def box_area(boxes: Boxes) -> Boxes:
    """Areas (...) [px^2]; 0 for boxes without width or height."""
    return _area(boxes[..., :2], boxes[..., 2:])


def intersection_area(a: Boxes, b: Boxes) -> Boxes:
    """Areas (...) [px^2] that two boxes share."""
    xp = a.__array_namespace__()
    return _area(xp.maximum(a[..., :2], b[..., :2]), xp.minimum(a[..., 2:], b[..., 2:]))


def intersection_over_union(a: Boxes, b: Boxes) -> Boxes:
    """Intersection over union (...); 0 where either box is empty."""
    return _iou_and_union(a, b)[0]


def pairwise_iou(a: Boxes, b: Boxes) -> Boxes:
    """Intersection over union (n, m) of every box of (n, 4) with every one of (m, 4)."""
    return intersection_over_union(a[:, None, :], b[None, :, :])


def generalized_iou(a: Boxes, b: Boxes) -> Boxes:
    """Generalised intersection over union (...), which has a gradient also for disjoint boxes.

    Rezatofighi et al., "Generalized intersection over union", CVPR 2019, algorithm 1.
    """
    xp = a.__array_namespace__()
    iou, union = _iou_and_union(a, b)
    hull = _area(xp.minimum(a[..., :2], b[..., :2]), xp.maximum(a[..., 2:], b[..., 2:]))
    hull = xp.maximum(hull, _MIN_AREA)
    return iou - (hull - union) / hull


def _iou_and_union(a: Boxes, b: Boxes) -> tuple[Boxes, Boxes]:
    """Intersection over union, and the area of the union [px^2]."""
    shared = intersection_area(a, b)
    union = box_area(a) + box_area(b) - shared
    return shared / a.__array_namespace__().maximum(union, _MIN_AREA), union


def _area(low: Boxes, high: Boxes) -> Boxes:
    sides = low.__array_namespace__().maximum(high - low, 0.0)
    return sides[..., 0] * sides[..., 1]
