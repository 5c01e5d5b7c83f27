"""Evaluation of a detector on a data set: the metrics of `rpojax detector evaluate`."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.training.detector.evaluation.average_precision import Matches, average_precisions, match_detections
from rpojax.training.detector.evaluation.box_ranges import IsOutside, outside_contrast_range, outside_size_range
from rpojax.training.detector.evaluation.confidence_intervals import bootstrap_interval, wilson_interval
from rpojax.training.detector.evaluation.label_agreement import implausible_labels
from rpojax.training.detector.evaluation.pair_recall import pair_recalls
from rpojax.training.labelled_pictures.dataset_faults import noticed
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
from rpojax.vision.detector.box_decoding import Detections
from rpojax.vision.detector.two_stage_detector import SCORE_THRESHOLD, detect
from rpojax.vision.intersection_over_union import pairwise_iou

MIN_SIDE_PX = 16.0
"""Least long side of a box that counts in the overall metrics."""
SIZE_BINS_PX = (0.0, 8.0, 16.0, 24.0, 40.0, 64.0, 1e9)
CONTRAST_BINS = (0.0, 10.0, 25.0, 60.0, 1e9)
BOXES_PER_IMAGE = 8
_BATCH = 50
_LARGE_ENOUGH = outside_size_range(MIN_SIDE_PX)


@dataclasses.dataclass(frozen=True)
class ImageDetections:
    """Detections per image: boxes (k, 4) left, top, right, bottom [px] and scores (k,)."""

    boxes: list[np.ndarray]
    scores: list[np.ndarray]


def detect_images(
    params: Any, images: np.ndarray, detector: Callable[[Any, jax.Array, int], Detections] = detect
) -> ImageDetections:
    """Detections in images (n, p, p, 3) of 8 bit sRGB codes; `detector` is both networks or the proposals alone."""
    boxes, scores = [], []
    for start in range(0, len(images), _BATCH):
        part = images[start : start + _BATCH]
        # Padded to one shape, so that the program is compiled once.
        full = np.concatenate([part, np.zeros((_BATCH - len(part), *part.shape[1:]), np.uint8)])
        result = _detect(detector, params, jnp.asarray(full.astype(np.float32) / 255.0))
        for index in range(len(part)):
            score = np.asarray(result.score[index], np.float64)
            kept = score > 1e-3
            scores.append(score[kept])
            boxes.append(np.asarray(result.box_px[index], np.float64)[kept])
    return ImageDetections(boxes, scores)


@partial(jax.jit, static_argnums=0)
def _detect(detector: Callable[[Any, jax.Array, int], Detections], params: Any, images: jax.Array) -> Detections:
    return detector(params, images, BOXES_PER_IMAGE)


def detection_metrics(
    found: ImageDetections,
    data: DetectionDataset,
    is_outside: IsOutside = _LARGE_ENOUGH,
    intervals: bool = False,
) -> dict[str, Any]:
    """Metrics over the true boxes that are not outside of a range, by default one of sizes from `MIN_SIDE_PX` on.

    `is_outside` gives a flag for each of the boxes (n, 4) in an image (p, p, 3); found boxes without a true one are
    ignored by it too. `median_iou` and `recall` count misses as 0; `false_alarms_per_empty_frame` counts boxes over the
    threshold in images without a spacecraft. With `intervals`, `interval_95` has the interval of each figure.
    """
    ignored_truth = [is_outside(image, real) for image, real in zip(data.images, data.boxes, strict=True)]
    ignored_boxes = [is_outside(image, boxes) for image, boxes in zip(data.images, found.boxes, strict=True)]
    matches = match_detections(found.boxes, found.scores, data.boxes, ignored_truth, ignored_boxes)
    best = _best_overlaps(found, data, ignored_truth)
    overlaps = np.concatenate(best)
    empty = _boxes_in_empty_frames(found, data)
    precision = average_precisions(matches)
    metrics = {
        "boxes": len(overlaps),
        "map50": _rounded(precision[0]),
        "map50_95": _rounded(np.mean(precision)),
        "median_iou": _rounded(np.median(overlaps)) if len(overlaps) else None,
        "recall": _rounded(np.mean(overlaps >= 0.5)) if len(overlaps) else None,
        "empty_frames": len(empty),
        "false_alarms_per_empty_frame": _rounded(np.mean(empty)) if len(empty) else None,
    }
    return {**metrics, "interval_95": _intervals(matches, best, empty)} if intervals else metrics


def _best_overlaps(
    found: ImageDetections, data: DetectionDataset, ignored_truth: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """For each image the IoU of every true box that counts with the best box over the threshold, or 0."""
    best = []
    for boxes, scores, real, ignored in zip(found.boxes, found.scores, data.boxes, ignored_truth, strict=True):
        iou = pairwise_iou(boxes[scores >= SCORE_THRESHOLD], real.astype(np.float64))
        best.append(np.max(iou, axis=0, initial=0.0)[~ignored])
    return best


def _boxes_in_empty_frames(found: ImageDetections, data: DetectionDataset) -> np.ndarray:
    """Number of boxes over the threshold in each image without a spacecraft."""
    numbers = [(s >= SCORE_THRESHOLD).sum() for s, real in zip(found.scores, data.boxes, strict=True) if len(real) == 0]
    return np.array(numbers, int)


def _intervals(matches: Sequence[Matches], best: Sequence[np.ndarray], empty: np.ndarray) -> dict[str, Any]:
    """Intervals of 95 % of the metrics; of false alarms that of the fraction of empty frames with a box."""
    images, overlaps = len(best), np.concatenate(best)
    image = np.repeat(np.arange(images), [len(values) for values in best])

    def median_of(repeats: np.ndarray) -> float:
        return float(np.median(np.repeat(overlaps, repeats[image].astype(int)))) if repeats[image].any() else np.nan

    return {
        "map50": bootstrap_interval(matches[0].average_precision, images),
        "map50_95": bootstrap_interval(
            lambda times: float(np.mean([m.average_precision(times) for m in matches])), images
        ),
        "median_iou": bootstrap_interval(median_of, images),
        "recall": wilson_interval(int((overlaps >= 0.5).sum()), len(overlaps)),
        "empty_frames_with_a_box": wilson_interval(int((empty > 0).sum()), len(empty)),
    }


def noticed_labels(found: ImageDetections, data: DetectionDataset) -> tuple[str, ...]:
    """What is unlikely about labels by what was detected, told to the user as a `Notice`."""
    return noticed("labels", implausible_labels(found.boxes, found.scores, data))


def evaluation_report(found: ImageDetections, data: DetectionDataset) -> dict[str, Any]:
    """Overall metrics with intervals, and by apparent size, contrast, background, neighbours, and craft."""
    return {
        "images": len(data),
        "warnings": [*data.notes, *noticed_labels(found, data)],
        "threshold": SCORE_THRESHOLD,
        "least_side_px": MIN_SIDE_PX,
        **detection_metrics(found, data, intervals=True),
        "by_size": _metrics_by_range(found, data, SIZE_BINS_PX, "px", outside_size_range),
        "by_contrast": _metrics_by_range(found, data, CONTRAST_BINS, "codes", outside_contrast_range),
        "by_background": _metrics_by_name(data.backgrounds, found, data),
        "pairs": pair_recalls(found.boxes, found.scores, data.boxes, SCORE_THRESHOLD, MIN_SIDE_PX),
        "by_craft": {
            name: _without_empty_frames(values) for name, values in _metrics_by_name(data.craft, found, data).items()
        },
    }


def _metrics_by_range(
    found: ImageDetections,
    data: DetectionDataset,
    bins: Sequence[float],
    unit: str,
    outside: Callable[[float, float], IsOutside],
) -> dict[str, Any]:
    """Metrics of boxes in each range of a quantity."""
    parts = {}
    for low, high in itertools.pairwise(bins):
        name = f"{low:g} to {high:g} {unit}" if high < 1e9 else f"from {low:g} {unit}"
        parts[name] = _without_empty_frames(detection_metrics(found, data, outside(low, high), intervals=True))
    return parts


def _metrics_by_name(
    names: tuple[str, ...], found: ImageDetections, data: DetectionDataset
) -> dict[str, dict[str, Any]]:
    """Metrics of the images of each name."""
    parts = {}
    for name in sorted(set(names)):
        chosen = np.array([i for i, other in enumerate(names) if other == name])
        part = ImageDetections([found.boxes[i] for i in chosen], [found.scores[i] for i in chosen])
        parts[name] = detection_metrics(part, data.subset(chosen), intervals=True)
    return parts


def _without_empty_frames(values: dict[str, Any]) -> dict[str, Any]:
    """Metrics without those of empty images, which do not depend on the size of boxes."""
    inner = {"interval_95": _without_empty_frames(values["interval_95"])} if "interval_95" in values else {}
    return {name: value for name, value in values.items() if "empty" not in name} | inner


def _rounded(value: Any) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
