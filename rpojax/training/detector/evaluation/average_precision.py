"""Average precision by the rule of COCO (Lin et al., 2014): 101 recalls, greedy matching by falling score."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from rpojax.vision.intersection_over_union import pairwise_iou

IOU_THRESHOLDS = np.linspace(0.5, 0.95, 10)
_RECALLS = np.linspace(0.0, 1.0, 101)


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
