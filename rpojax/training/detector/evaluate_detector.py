"""Evaluation of a detector on a data set: the metrics of `rpojax detector evaluate`."""

import dataclasses
import itertools
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.training.detector.average_precision import average_precision
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
from rpojax.vision.detector.box_decoding import Detections
from rpojax.vision.detector.two_stage_detector import SCORE_THRESHOLD, detect
from rpojax.vision.intersection_over_union import pairwise_iou

MIN_SIDE_PX = 16.0
"""Least long side of a box that counts in the overall metrics."""
SIZE_BINS_PX = (0.0, 8.0, 16.0, 24.0, 40.0, 64.0, 1e9)
BOXES_PER_IMAGE = 8
_BATCH = 50


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


def long_side(boxes: np.ndarray) -> np.ndarray:
    """Longer side (n,) [px] of boxes (n, 4)."""
    return np.max(boxes[:, 2:] - boxes[:, :2], axis=1, initial=0.0) if len(boxes) else np.zeros(0)


def detection_metrics(
    found: ImageDetections, data: DetectionDataset, min_px: float = MIN_SIDE_PX, max_px: float = 1e9
) -> dict[str, Any]:
    """Metrics over the true boxes whose long side is in a range [px]; boxes outside of it are ignored.

    `median_iou` and `recall` count misses as 0; `false_alarms_per_empty_frame` counts boxes over the threshold in
    images without a spacecraft.
    """
    ignored_truth = [_outside_size_range(boxes, min_px, max_px) for boxes in data.boxes]
    ignored_boxes = [_outside_size_range(boxes, min_px, max_px) for boxes in found.boxes]
    precision = average_precision(found.boxes, found.scores, data.boxes, ignored_truth, ignored_boxes)
    best = []
    for boxes, scores, real, ignored in zip(found.boxes, found.scores, data.boxes, ignored_truth, strict=True):
        iou = pairwise_iou(boxes[scores >= SCORE_THRESHOLD], real.astype(np.float64))
        best += list(np.max(iou, axis=0, initial=0.0)[~ignored])
    empty = [
        int((s >= SCORE_THRESHOLD).sum()) for s, real in zip(found.scores, data.boxes, strict=True) if len(real) == 0
    ]
    return {
        "boxes": len(best),
        "map50": _rounded(precision[0]),
        "map50_95": _rounded(precision.mean()),
        "median_iou": _rounded(np.median(best)) if best else None,
        "recall": _rounded(np.mean(np.array(best) >= 0.5)) if best else None,
        "empty_frames": len(empty),
        "false_alarms_per_empty_frame": _rounded(np.mean(empty)) if empty else None,
    }


def evaluation_report(found: ImageDetections, data: DetectionDataset) -> dict[str, Any]:
    """Overall metrics, and by apparent size, by background, and for the packaged target and others."""
    by_size = {}
    for low, high in itertools.pairwise(SIZE_BINS_PX):
        name = f"{low:g} to {high:g} px" if high < 1e9 else f"from {low:g} px"
        by_size[name] = _without_empty_frames(detection_metrics(found, data, low, high))
    return {
        "images": len(data),
        "threshold": SCORE_THRESHOLD,
        "least_side_px": MIN_SIDE_PX,
        **detection_metrics(found, data),
        "by_size": by_size,
        "by_background": _metrics_by_name(data.backgrounds, found, data),
        "by_craft": {
            name: _without_empty_frames(values) for name, values in _metrics_by_name(data.craft, found, data).items()
        },
    }


def _metrics_by_name(
    names: tuple[str, ...], found: ImageDetections, data: DetectionDataset
) -> dict[str, dict[str, Any]]:
    """Metrics of the images of each name."""
    parts = {}
    for name in sorted(set(names)):
        chosen = np.array([i for i, other in enumerate(names) if other == name])
        part = ImageDetections([found.boxes[i] for i in chosen], [found.scores[i] for i in chosen])
        parts[name] = detection_metrics(part, data.subset(chosen))
    return parts


def _without_empty_frames(values: dict[str, Any]) -> dict[str, Any]:
    """Metrics without those of empty images, which do not depend on the size of boxes."""
    return {name: value for name, value in values.items() if "empty" not in name}


def _outside_size_range(boxes: np.ndarray, min_px: float, max_px: float) -> np.ndarray:
    side = long_side(boxes)
    return (side < min_px) | (side >= max_px)


def _rounded(value: Any) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
