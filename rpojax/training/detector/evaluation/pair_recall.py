"""How often both of two near spacecraft are found, each with a box of its own."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rpojax.training.detector.evaluation.box_ranges import long_side
from rpojax.training.detector.evaluation.confidence_intervals import wilson_interval
from rpojax.vision.intersection_over_union import intersection_area, pairwise_iou

_NEAR_GAP_FRACTION = 0.3
"""Largest gap of two near spacecraft by the mean of their sides along it."""
_LEAST_IOU = 0.5


def pair_recalls(
    boxes: Sequence[np.ndarray],
    scores: Sequence[np.ndarray],
    truth: Sequence[np.ndarray],
    threshold: float,
    min_px: float,
) -> dict[str, Any]:
    """Fraction of the images with two spacecraft in which both are found, for those near and those overlapping.

    A spacecraft is found by a box (n, 4) with a score (n,) from the threshold on and an IoU of half; two need two
    boxes. Images count whose true boxes (2, 4) both have a long side of `min_px`.
    """
    hits: dict[str, list[bool]] = {"near": [], "overlapping": []}
    for found, score, real in zip(boxes, scores, truth, strict=True):
        kind = pair_kind(real, min_px)
        if kind is not None:
            hits[kind].append(_both_found(found[score >= threshold], real))
    return {
        kind: {
            "images": len(values),
            "both_found": round(float(np.mean(values)), 4) if values else None,
            "interval_95": wilson_interval(sum(values), len(values)),
        }
        for kind, values in hits.items()
    }


def pair_kind(real: np.ndarray, min_px: float) -> str | None:
    """'overlapping' or 'near' for two boxes (2, 4) of at least `min_px`; None for other numbers, sizes and gaps."""
    if len(real) != 2 or long_side(real).min() < min_px:
        return None
    if intersection_area(real[:1], real[1:])[0] > 0.0:
        return "overlapping"
    gaps = np.maximum(real[0, :2] - real[1, 2:], real[1, :2] - real[0, 2:])
    axis = int(np.argmax(gaps))
    size = float(np.mean(real[:, 2 + axis] - real[:, axis]))
    return "near" if gaps[axis] < _NEAR_GAP_FRACTION * size else None


def _both_found(found: np.ndarray, real: np.ndarray) -> bool:
    """Whether two boxes match one true box (2, 4) each."""
    right = pairwise_iou(found, real) >= _LEAST_IOU
    return bool(right.any(axis=0).all() and right.any(axis=1).sum() >= 2)
