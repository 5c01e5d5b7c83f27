"""Average precision by the rule of COCO (Lin et al., 2014): 101 recalls, greedy matching by falling score."""

from collections.abc import Sequence

import numpy as np

from rpojax.vision.intersection_over_union import pairwise_iou

IOU_THRESHOLDS = np.linspace(0.5, 0.95, 10)
_RECALLS = np.linspace(0.0, 1.0, 101)


def average_precision(
    boxes: Sequence[np.ndarray],
    scores: Sequence[np.ndarray],
    truth: Sequence[np.ndarray],
    ignored_truth: Sequence[np.ndarray] | None = None,
    ignored_boxes: Sequence[np.ndarray] | None = None,
    thresholds: np.ndarray = IOU_THRESHOLDS,
) -> np.ndarray:
    """Average precision at every threshold of IoU; NaN without true boxes.

    For each image boxes (n, 4) with scores (n,), and true boxes (m, 4). Matches of true boxes in `ignored_truth` (m,)
    do not count, nor do unmatched boxes in `ignored_boxes` (n,), such as those outside of a range of sizes.
    """
    results = []
    for threshold in thresholds:
        score, right, counted = [], [], []
        for index, real in enumerate(truth):
            ignored = np.zeros(len(real), bool) if ignored_truth is None else ignored_truth[index]
            unmatched_ignored = np.zeros(len(boxes[index]), bool) if ignored_boxes is None else ignored_boxes[index]
            order = np.argsort(-scores[index], kind="mergesort")
            matched = _match(pairwise_iou(boxes[index][order], real), ignored, float(threshold))
            hit = matched >= 0
            of_ignored = np.append(ignored, False)[matched]
            score.append(scores[index][order])
            right.append(hit & ~of_ignored)
            counted.append(np.where(hit, ~of_ignored, ~unmatched_ignored[order]))
        true_count = sum(len(real) for real in truth)
        if ignored_truth is not None:
            true_count -= sum(int(ignored.sum()) for ignored in ignored_truth)
        results.append(
            _mean_interpolated_precision(
                np.concatenate(score), np.concatenate(right), np.concatenate(counted), true_count
            )
        )
    return np.array(results)


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


def _mean_interpolated_precision(score: np.ndarray, right: np.ndarray, counted: np.ndarray, true_count: int) -> float:
    """Mean over 101 recalls of the largest precision at that recall or a larger one."""
    if true_count == 0:
        return float("nan")
    order = np.argsort(-score, kind="mergesort")
    right, counted = right[order], counted[order]
    hits, misses = np.cumsum(right & counted), np.cumsum(~right & counted)
    recall = hits / true_count
    precision = hits / np.maximum(hits + misses, 1e-12)
    precision = np.maximum.accumulate(precision[::-1])[::-1]
    place = np.searchsorted(recall, _RECALLS, side="left")
    return float(np.append(precision, 0.0)[np.minimum(place, len(precision))].mean())
