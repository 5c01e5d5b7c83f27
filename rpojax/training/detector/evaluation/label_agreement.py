"""Agreement of labels with boxes of which a detector is sure: labels that mean something else lie elsewhere."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np

from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
from rpojax.vision.detector.two_stage_detector import SCORE_THRESHOLD
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


def implausible_labels(
    boxes: Sequence[np.ndarray], scores: Sequence[np.ndarray], data: DetectionDataset
) -> tuple[str, ...]:
    """Sentences on labels that do not agree with boxes of which a detector is sure.

    Args:
        boxes: for every image found boxes (k, 4) left, top, right, bottom [px]
        scores: of these (k,)
        data: the images with their labels
    """
    sure = np.array([np.max(each, initial=0.0) >= SCORE_THRESHOLD for each in scores], bool)
    labelled = np.array([len(each) > 0 for each in data.boxes], bool)
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
    counts = [len(each) for each in data.boxes]
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
