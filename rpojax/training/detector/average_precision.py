"""Average precision of found boxes by COCO's rule: 101 recalls, greedy matches by falling score (Lin et al., 2014)."""

from collections.abc import Sequence

import numpy as np

IOU_THRESHOLDS = np.linspace(0.5, 0.95, 10)
_RECALLS = np.linspace(0.0, 1.0, 101)


def pairwise_iou(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Intersection over union (n, m) of boxes (n, 4) and (m, 4): left, top, right, bottom."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    intersection = np.prod(np.maximum(high - low, 0.0), axis=2)
    union = np.prod(a[:, 2:] - a[:, :2], axis=1)[:, None] + np.prod(b[:, 2:] - b[:, :2], axis=1)[None, :] - intersection
    return intersection / np.maximum(union, 1e-12)


def average_precision(
    boxes: Sequence[np.ndarray],
    scores: Sequence[np.ndarray],
    truth: Sequence[np.ndarray],
    ignored_truth: Sequence[np.ndarray] | None = None,
    ignored_boxes: Sequence[np.ndarray] | None = None,
    thresholds: np.ndarray = IOU_THRESHOLDS,
) -> np.ndarray:
    """Average precision at every threshold of IoU; NaN where there is nothing to find.

    For each picture boxes (n, 4) with scores (n,), and true boxes (m, 4). Finding one that is `ignored` (m,) is neither
    right nor wrong, and so is a box that matches nothing and is `unasked` (n,), such as one out of the range of sizes.
    """
    results = []
    for threshold in thresholds:
        score, right, counted = [], [], []
        for index, real in enumerate(truth):
            skip = np.zeros(len(real), bool) if ignored_truth is None else ignored_truth[index]
            idle = np.zeros(len(boxes[index]), bool) if ignored_boxes is None else ignored_boxes[index]
            order = np.argsort(-scores[index], kind="mergesort")
            matched = _match(pairwise_iou(boxes[index][order], real), skip, float(threshold))
            hit = matched >= 0
            of_ignored = np.append(skip, False)[matched]
            score.append(scores[index][order])
            right.append(hit & ~of_ignored)
            counted.append(np.where(hit, ~of_ignored, ~idle[order]))
        wanted = sum(len(real) for real in truth)
        if ignored_truth is not None:
            wanted -= sum(int(skip.sum()) for skip in ignored_truth)
        results.append(
            _mean_interpolated_precision(np.concatenate(score), np.concatenate(right), np.concatenate(counted), wanted)
        )
    return np.array(results)


def _match(overlap: np.ndarray, skip: np.ndarray, threshold: float) -> np.ndarray:
    """For every box (n,) the number of the true box that it takes, or -1; those to skip are taken last."""
    order = np.argsort(skip, kind="mergesort")
    taken = np.zeros(len(order), bool)
    found = np.full(len(overlap), -1)
    for index, row in enumerate(overlap):
        best, chosen = min(threshold, 1.0 - 1e-10), -1
        for other in order:
            if taken[other]:
                continue
            if chosen >= 0 and not skip[chosen] and skip[other]:
                break
            if row[other] >= best:
                best, chosen = row[other], other
        if chosen >= 0:
            taken[chosen] = True
            found[index] = chosen
    return found


def _mean_interpolated_precision(score: np.ndarray, right: np.ndarray, counted: np.ndarray, wanted: int) -> float:
    """Mean over 101 recalls of the best precision at that recall or beyond."""
    if wanted == 0:
        return float("nan")
    order = np.argsort(-score, kind="mergesort")
    right, counted = right[order], counted[order]
    hits, misses = np.cumsum(right & counted), np.cumsum(~right & counted)
    recall = hits / wanted
    precision = hits / np.maximum(hits + misses, 1e-12)
    precision = np.maximum.accumulate(precision[::-1])[::-1]
    place = np.searchsorted(recall, _RECALLS, side="left")
    return float(np.append(precision, 0.0)[np.minimum(place, len(precision))].mean())
