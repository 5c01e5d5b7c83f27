"""Average precision by the rule of COCO (Lin et al., 2014): 101 recalls, greedy matching by falling score."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rpojax.vision.intersection_over_union import intersection_area, pairwise_iou

IOU_THRESHOLDS = np.linspace(0.5, 0.95, 10)
_RECALLS = np.linspace(0.0, 1.0, 101)
_RING_FRACTION = 0.25
_MIN_RING_PX = 2
IsOutside = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Flags (n,) of boxes (n, 4) in an image (p, p, 3)."""
_QUANTILE = 1.959964
"""Of the standard normal at 97.5 %."""
_REPLICATES = 200
Interval = tuple[float, float]
_NEAR_GAP_FRACTION = 0.3
"""Largest gap of two near spacecraft by the mean of their sides along it."""
_LEAST_IOU = 0.5


@dataclasses.dataclass(frozen=True)
class Matches:
    """Detections of all images by falling score, matched to true boxes at one threshold of IoU.

    Attributes:
        is_right: (n,) whether it has a true box that counts
        is_counted: (n,) whether it counts, right or wrong
        image: (n,) index of its image
        true_counts: (images,) true boxes of each image that count
    """

    is_right: np.ndarray
    is_counted: np.ndarray
    image: np.ndarray
    true_counts: np.ndarray

    def average_precision(self, repeats: np.ndarray | None = None) -> float:
        """Mean over 101 recalls of the largest precision at that recall or a larger one; NaN without true boxes.

        `repeats` (images,) says how often each image counts, as in a bootstrap; by default once.
        """
        weight = np.ones(len(self.true_counts)) if repeats is None else repeats
        true_count = float(weight @ self.true_counts)
        if true_count == 0.0:
            return float("nan")
        times = weight[self.image]
        hits = np.cumsum(times * (self.is_right & self.is_counted))
        misses = np.cumsum(times * (~self.is_right & self.is_counted))
        recall = hits / true_count
        precision = hits / np.maximum(hits + misses, 1e-12)
        precision = np.maximum.accumulate(precision[::-1])[::-1]
        place = np.searchsorted(recall, _RECALLS, side="left")
        return float(np.append(precision, 0.0)[np.minimum(place, len(precision))].mean())


def average_precisions(matches: Sequence[Matches]) -> np.ndarray:
    """Average precision of detections matched at several thresholds of IoU; NaN without true boxes."""
    return np.array([at_threshold.average_precision() for at_threshold in matches])


def match_detections(
    boxes: Sequence[np.ndarray],
    scores: Sequence[np.ndarray],
    truth: Sequence[np.ndarray],
    ignored_truth: Sequence[np.ndarray] | None = None,
    ignored_boxes: Sequence[np.ndarray] | None = None,
    thresholds: np.ndarray = IOU_THRESHOLDS,
) -> list[Matches]:
    """Detections matched to true boxes at every threshold of IoU.

    For each image boxes (n, 4) with scores (n,), and true boxes (m, 4). Matches of true boxes in `ignored_truth` (m,)
    do not count, nor do unmatched boxes in `ignored_boxes` (n,), such as those outside of a range of sizes.
    """
    results = []
    image = np.repeat(np.arange(len(boxes)), [len(found) for found in boxes])
    ignored_real = ignored_truth or [np.zeros(len(real), bool) for real in truth]
    counts = np.array([len(real) - int(ignored.sum()) for real, ignored in zip(truth, ignored_real, strict=True)])
    for threshold in thresholds:
        score, right, counted = [], [], []
        for index, real in enumerate(truth):
            ignored = ignored_real[index]
            unmatched_ignored = np.zeros(len(boxes[index]), bool) if ignored_boxes is None else ignored_boxes[index]
            order = np.argsort(-scores[index], kind="mergesort")
            matched = _match(pairwise_iou(boxes[index][order], real), ignored, float(threshold))
            hit = matched >= 0
            of_ignored = np.append(ignored, False)[matched]
            score.append(scores[index][order])
            right.append(hit & ~of_ignored)
            counted.append(np.where(hit, ~of_ignored, ~unmatched_ignored[order]))
        falling = np.argsort(-np.concatenate(score), kind="mergesort")
        is_right, is_counted = np.concatenate(right)[falling], np.concatenate(counted)[falling]
        results.append(Matches(is_right, is_counted, image[falling], counts))
    return results


def _match(iou: np.ndarray, ignored: np.ndarray, threshold: float) -> np.ndarray:
    """Index of the true box matched by each box (n,), or -1; ignored true boxes are matched last."""
    order = np.argsort(ignored, kind="mergesort")
    taken = np.zeros(len(order), bool)
    found = np.full(len(iou), -1)
    for index, row in enumerate(iou):
        best, chosen = min(threshold, 1.0 - 1e-10), -1
        for other in order:
            if taken[other]:
                continue
            if chosen >= 0 and not ignored[chosen] and ignored[other]:
                break
            if row[other] >= best:
                best, chosen = row[other], other
        if chosen >= 0:
            taken[chosen] = True
            found[index] = chosen
    return found


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


def wilson_interval(hits: int, total: int) -> Interval | None:
    """Interval of a fraction of hits (Wilson, 1927); None of nothing."""
    if total == 0:
        return None
    share, square = hits / total, _QUANTILE**2
    center = (share + square / (2 * total)) / (1.0 + square / total)
    half = _QUANTILE * np.sqrt(share * (1.0 - share) / total + square / (4 * total**2)) / (1.0 + square / total)
    return round(float(max(0.0, center - half)), 4), round(float(min(1.0, center + half)), 4)


def bootstrap_interval(statistic: Callable[[np.ndarray], float], images: int, seed: int = 0) -> Interval | None:
    """Interval of a statistic of how often each image (images,) counts; None if a replicate has no finite one.

    The percentile interval of Efron and Tibshirani, "An introduction to the bootstrap", 1993, section 13.3.
    """
    rng = np.random.default_rng(seed)
    draws = [
        statistic(rng.multinomial(images, np.full(images, 1.0 / images)).astype(float)) for _ in range(_REPLICATES)
    ]
    if not np.isfinite(draws).all():
        return None
    low, high = np.quantile(draws, [0.025, 0.975])
    return round(float(low), 4), round(float(high), 4)


def pair_recalls(
    boxes: Sequence[np.ndarray],
    scores: Sequence[np.ndarray],
    truth: Sequence[np.ndarray],
    threshold: float,
    min_px: float,
) -> dict[str, Any]:
    """Fraction of images with two spacecraft in which both are found, for near and for overlapping pairs.

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
