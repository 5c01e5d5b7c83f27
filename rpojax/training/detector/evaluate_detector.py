"""Evaluation of the detector: average precision, pairs, false boxes, with intervals and by kind of image."""

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.training.detector.average_precision import (
    IsOutside,
    Matches,
    average_precisions,
    bootstrap_interval,
    match_detections,
    outside_contrast_range,
    outside_size_range,
    pair_recalls,
    wilson_interval,
)
from rpojax.training.labelled_pictures.dataset_faults import noticed
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
from rpojax.vision.detector.box_decoding import Detections
from rpojax.vision.detector.two_stage_detector import SCORE_THRESHOLD, DetectorParams, detect, with_shifted_score
from rpojax.vision.intersection_over_union import intersection_over_union, pairwise_iou

_LEAST_PICTURES: Final = 5
_MANY: Final = 0.5
"""Share of pictures, sure boxes of which are elsewhere, that is no accident of a detector."""
_SOME: Final = 0.1
"""Share of pictures that is worth a line if another meaning of their labels explains it, in which nothing is fitted."""
_AGREES, _APART, _GAIN, _TIE = 0.5, 0.1, 0.25, 0.05
"""Intersection over union of a label with a sure box: agreement, none, what an explanation has to gain, and a tie."""
_LONG, _GAIN_OF_LONG = 1.15, 0.1
"""Ratio of the sides of a box that is no square, and what of these an exchange of the sides has to gain."""
_EXCHANGED: Final = "width and height were exchanged"

_FORMS: Final[dict[str, tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]]] = {
    "left, top, right and bottom": (lambda box: box, lambda words: words),
    "left, top, width and height": (
        lambda box: np.stack([box[0], box[1], box[2] - box[0], box[3] - box[1]]),
        lambda words: np.stack([words[0], words[1], words[0] + words[2], words[1] + words[3]]),
    ),
    "centre, width and height": (
        lambda box: np.stack([*((box[:2] + box[2:]) / 2), *(box[2:] - box[:2])]),
        lambda words: np.concatenate([words[:2] - words[2:] / 2, words[:2] + words[2:] / 2]),
    ),
}
"""Four words of a label from its edges (4, n) left, top, right, bottom, and edges from the words."""
MIN_SIDE_PX = 16.0
"""Least long side of a box that counts in the overall metrics."""
SIZE_BINS_PX = (0.0, 8.0, 16.0, 24.0, 40.0, 64.0, 1e9)
CONTRAST_BINS = (0.0, 10.0, 25.0, 60.0, 1e9)
BOXES_PER_IMAGE = 8
_BATCH = 50
_LARGE_ENOUGH = outside_size_range(MIN_SIDE_PX)
EMPTY_SHARE = 0.01
"""Fraction of empty images whose best box is to reach the threshold."""
_LEAST_IMAGES = 100
_FEWEST_RESAMPLED = 10
"""Fewest images with a box that counts of which resamples tell anything: those of a single one are all the same."""


def implausible_labels(
    boxes: Sequence[np.ndarray], scores: Sequence[np.ndarray], data: DetectionDataset
) -> tuple[str, ...]:
    """Sentences on labels that do not agree with boxes of which a detector is sure.

    Args:
        boxes: for every image found boxes (k, 4) left, top, right, bottom [px]
        scores: of these (k,)
        data: the images with their labels
    """
    sure = np.array([np.max(score, initial=0.0) >= SCORE_THRESHOLD for score in scores], bool)
    labelled = np.array([len(image_boxes) > 0 for image_boxes in data.boxes], bool)
    both = np.flatnonzero(sure & labelled)
    best = [boxes[index][np.argmax(scores[index])] for index in both.tolist()]
    return (*_labels_lacking(sure[~labelled]), *(_labels_elsewhere(np.array(best), data.subset(both)) if best else ()))


def _labels_lacking(sure: np.ndarray) -> tuple[str, ...]:
    number = int(sure.sum())
    if number < max(_LEAST_PICTURES, _MANY * len(sure)):
        return ()
    return (f"the detector is sure of a spacecraft in {number} of {len(sure)} pictures without one: do labels lack?",)


def _labels_elsewhere(best: np.ndarray, data: DetectionDataset) -> tuple[str, ...]:
    """A sentence if labels are elsewhere than the best boxes (n, 4) [px] of their images."""
    pairs = zip(best, data.boxes, strict=True)
    now = np.array([pairwise_iou(box[None], labels.astype(float)).max() for box, labels in pairs])
    failing = np.flatnonzero(now < _AGREES)
    if len(failing) < max(_LEAST_PICTURES, _SOME * len(now)):
        return _sides_exchanged(best, data, now)
    found = f"{len(failing)} of {len(now)} pictures have labels elsewhere than boxes of which the detector is sure"
    is_many = len(failing) >= _MANY * len(now)
    gain, cause = _likely_cause(best[failing], data.subset(failing), fitted=is_many)
    if gain >= max(_AGREES, float(np.median(now[failing])) + _GAIN):
        return (f"{found}; most would agree if {cause}",)
    return (f"{found}: are they of these pictures?",) if np.mean(now < _APART) >= _MANY else ()


def _sides_exchanged(best: np.ndarray, data: DetectionDataset, now: np.ndarray) -> tuple[str, ...]:
    """A sentence if labels of which many still agree would agree more with width and height exchanged.

    `best` (n, 4) are boxes [px] of which the detector is sure, `now` (n,) their agreement with the labels.
    """
    sides = best[:, 2:] - best[:, :2]
    long = np.flatnonzero(sides.max(axis=1) > _LONG * np.maximum(sides.min(axis=1), 1e-9))
    if len(long) < max(_LEAST_PICTURES, _SOME * len(now)):
        return ()
    gain, cause = _likely_cause(best[long], data.subset(long), fitted=False)
    if cause != _EXCHANGED or gain < max(_AGREES, float(np.median(now[long])) + _GAIN_OF_LONG):
        return ()
    return (f"labels of {len(long)} long boxes of which the detector is sure would agree more if {cause}",)


def _likely_cause(best: np.ndarray, data: DetectionDataset, fitted: bool) -> tuple[float, str]:
    """What labels may mean instead so that they agree most with the best boxes, and their median agreement then."""
    sizes = data.file_sizes().astype(float)
    scale = sizes.max(axis=1, keepdims=True) / data.images.shape[1]
    counts = [len(image_boxes) for image_boxes in data.boxes]
    image = np.repeat(np.arange(len(best)), counts)
    labels, target = np.concatenate(data.boxes) * scale[image], (best * scale)[image]
    found = []
    meanings = _meanings(labels.T, sizes[image].T)
    for cause, edges in itertools.chain(meanings, _fitted_meanings(labels.T, target.T) if fitted else ()):
        agreement = np.zeros(len(best))
        np.maximum.at(agreement, image, intersection_over_union(target, edges.T))
        found.append((float(np.median(agreement)), cause))
    # Those that fit numbers come last, and reach a little more where another one explains it.
    return next(each for each in found if each[0] >= max(found)[0] - _TIE)


def _meanings(box: np.ndarray, size: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """What labels may mean, and their edges (4, n) [px] then.

    `box` (4, n) are the edges as they were read, and `size` (2, n) width and height of the pictures.
    """
    (left, top, right, bottom), (width, height) = box, size
    sides = np.concatenate([size, size])
    yield "x and y were exchanged", np.stack([top, left, bottom, right])
    yield "x and y were exchanged", np.stack([top, left, bottom, right]) * sides / sides[[1, 0, 3, 2]]
    for turned in _with_sides_exchanged(box, size):
        yield _EXCHANGED, turned
    yield "y pointed upwards", np.stack([left, height - bottom, right, height - top])
    yield "x pointed to the left", np.stack([width - right, top, width - left, bottom])
    yield "x pointed to the left and y upwards", np.concatenate([size - box[2:], size - box[:2]])
    for part, of in ((1, "fractions"), (100, "percent"), (1000, "thousandths")):
        yield f"they were {of} of the pictures", box * sides / part
    for (read, (to_words, _)), (meant, (_, to_edges)) in itertools.permutations(_FORMS.items(), 2):
        yield f"they were {meant} in place of {read}", to_edges(to_words(box))


def _with_sides_exchanged(box: np.ndarray, size: np.ndarray) -> Iterator[np.ndarray]:
    """Edges (4, n) [px] of boxes with exchanged sides: about the centre or the corner, in px or fractions."""
    low, sides = box[:2], box[2:] - box[:2]
    for turned in (sides[::-1], sides[::-1] * size / size[::-1]):
        middle = low + sides / 2
        yield np.concatenate([middle - turned / 2, middle + turned / 2])
        yield np.concatenate([low, low + turned])


def _fitted_meanings(box: np.ndarray, target: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Factors and shifts of edges (4, n) [px] that fit those of the best boxes (4, n), and edges with them."""
    times = float(np.median((box * target).sum(axis=0) / (box * box).sum(axis=0)))
    yield f"they were multiplied by {times:.3g}", times * box
    middle, half = (box[:2] + box[2:]) / 2, (box[2:] - box[:2]) / 2
    ratio = float(np.median((target[2:] - target[:2]) / (2 * half)))
    yield (
        f"their widths and heights were multiplied by {ratio:.3g}",
        np.concatenate([middle - ratio * half, middle + ratio * half]),
    )
    shift = np.median((target[:2] + target[2:]) / 2 - middle, axis=1)
    yield f"they were moved by {shift[0]:.3g}, {shift[1]:.3g} px", box + np.tile(shift, 2)[:, None]


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
    """Intervals of 95 % of the metrics; of false alarms that of the fraction of empty frames with a box.

    Those by resampling are None with fewer than ten images with a box.
    """
    images, overlaps = len(best), np.concatenate(best)
    image = np.repeat(np.arange(images), [len(values) for values in best])

    def median_of(repeats: np.ndarray) -> float:
        return float(np.median(np.repeat(overlaps, repeats[image].astype(int)))) if repeats[image].any() else np.nan

    def mean_precision(times: np.ndarray) -> float:
        return float(np.mean([each.average_precision(times) for each in matches]))

    resampled = {"map50": matches[0].average_precision, "map50_95": mean_precision, "median_iou": median_of}
    is_few = sum(len(values) > 0 for values in best) < _FEWEST_RESAMPLED
    return {
        **{name: None if is_few else bootstrap_interval(each, images) for name, each in resampled.items()},
        "recall": wilson_interval(int((overlaps >= 0.5).sum()), len(overlaps)),
        "empty_frames_with_a_box": wilson_interval(int((empty > 0).sum()), len(empty)),
    }


def noticed_labels(found: ImageDetections, data: DetectionDataset) -> tuple[str, ...]:
    """What the detections show to be unlikely about labels, told to the user as a `Notice`."""
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


def calibrate_score(params: DetectorParams, data: DetectionDataset) -> DetectorParams:
    """Parameters whose score reaches the threshold in a hundredth of the images of a data set that are empty.

    Scores move by the same log-odds, so their order stays. With fewer than a hundred empty images nothing moves.
    """
    empty = data.subset(np.array([i for i, boxes in enumerate(data.boxes) if len(boxes) == 0], int))
    if len(empty) < _LEAST_IMAGES:
        return params
    best = np.array([np.max(scores, initial=1e-6) for scores in detect_images(params, empty.images).scores])
    reached = float(np.quantile(best, 1.0 - EMPTY_SHARE))
    return with_shifted_score(params, _log_odds(SCORE_THRESHOLD) - _log_odds(reached))


def _log_odds(score: float) -> float:
    return float(np.log(score) - np.log1p(-score))
