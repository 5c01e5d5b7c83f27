"""Labels that mean something else than their format says are told by what a detector finds."""

from collections.abc import Callable

import numpy as np
import pytest

from rpojax.training.detector.evaluate_detector import implausible_labels
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

WIDTH, HEIGHT, SIZE, COUNT = 200.0, 100.0, 128, 20
SCALE = SIZE / WIDTH
SIDES = np.array([WIDTH, HEIGHT] * 2)


def truth() -> np.ndarray:
    """Boxes (n, 4) left, top, right, bottom [px] of pictures of 200 x 100 px, one in each."""
    rng = np.random.default_rng(3)
    size = rng.uniform([20, 15], [50, 40], (COUNT, 2))
    low = rng.uniform(0, 1, (COUNT, 2)) * ([WIDTH, HEIGHT] - size)
    return np.concatenate([low, low + size], axis=1)


def said(labels: np.ndarray, found: np.ndarray, score: float = 0.9, lacking: int = 0) -> tuple[str, ...]:
    """Sentences on labels (n, 4) where a detector finds other boxes (n, 4) [px]; the first ones are `lacking`."""
    boxes = [row[None] * SCALE for row in labels]
    boxes[:lacking] = [np.zeros((0, 4))] * lacking
    data = DetectionDataset(
        np.zeros((COUNT, SIZE, SIZE, 3), np.uint8),
        tuple(boxes),
        ("unknown",) * COUNT,
        sizes=np.tile([int(WIDTH), int(HEIGHT)], (COUNT, 1)),
    )
    noise = np.random.default_rng(1).normal(0.0, 0.5, found.shape)
    return implausible_labels([row[None] * SCALE for row in found + noise], [np.array([score])] * COUNT, data)


def corners_as_sizes(box: np.ndarray) -> np.ndarray:
    return np.concatenate([box[:, :2], box[:, :2] + box[:, 2:]], axis=1)


def centre_as_corner(box: np.ndarray) -> np.ndarray:
    half = (box[:, 2:] - box[:, :2]) / 2
    return box + np.tile(half, 2)


def smaller(box: np.ndarray) -> np.ndarray:
    middle, half = (box[:, :2] + box[:, 2:]) / 2, (box[:, 2:] - box[:, :2]) / 4
    return np.concatenate([middle - half, middle + half], axis=1)


def exchanged_sides(box: np.ndarray, to_pixels: np.ndarray = SIDES[:2] / SIDES[:2]) -> np.ndarray:
    middle, half = (box[:, :2] + box[:, 2:]) / 2, (box[:, 2:] - box[:, :2])[:, ::-1] * to_pixels / 2
    return np.concatenate([middle - half, middle + half], axis=1)


def half_in_fractions(box: np.ndarray) -> np.ndarray:
    return np.concatenate([box[:10], box[10:] / SIDES])


@pytest.mark.parametrize(
    ("change", "number", "cause"),
    [
        (lambda box: box[:, [1, 0, 3, 2]], COUNT, "x and y were exchanged"),
        (lambda box: (box / SIDES)[:, [1, 0, 3, 2]] * SIDES, COUNT, "x and y were exchanged"),
        (lambda box: exchanged_sides(box, SIDES[:2] / SIDES[1::-1]), 6, "width and height were exchanged"),
        (lambda box: np.abs([0, HEIGHT, 0, HEIGHT] - box)[:, [0, 3, 2, 1]], COUNT, "y pointed upwards"),
        (lambda box: np.abs([WIDTH, 0, WIDTH, 0] - box)[:, [2, 1, 0, 3]], COUNT, "x pointed to the left"),
        (lambda box: (SIDES - box)[:, [2, 3, 0, 1]], COUNT, "x pointed to the left and y upwards"),
        (lambda box: 100 * box / SIDES, COUNT, "they were percent of the pictures"),
        (half_in_fractions, 10, "they were fractions of the pictures"),
        (corners_as_sizes, COUNT, "left, top, right and bottom in place of left, top, width and height"),
        (centre_as_corner, COUNT, "centre, width and height in place of left, top, width and height"),
        (lambda box: 0.6 * box, COUNT, "they were multiplied by 1.6"),
        (smaller, COUNT, "widths and heights were multiplied by 2"),
        (lambda box: box + np.array([25.0, -20.0, 25.0, -20.0]), COUNT, "they were moved by -2"),
    ],
)
def test_the_meaning_under_which_labels_agree_is_named(
    change: Callable[[np.ndarray], np.ndarray], number: int, cause: str
) -> None:
    (sentence,) = said(change(truth()), truth())
    assert cause in sentence
    assert int(sentence.split()[0]) >= 0.6 * number  # a few agree by chance


def test_labels_of_other_pictures_are_told_without_a_cause() -> None:
    (sentence,) = said(np.random.default_rng(0).permutation(truth()), truth())
    assert sentence.endswith("are they of these pictures?")


def test_right_labels_and_a_detector_that_sometimes_errs_or_is_unsure_say_nothing() -> None:
    found = truth()
    found[:8] = [0.0, 0.0, 15.0, 15.0]
    assert said(truth(), truth()) == said(truth(), found) == said(truth()[::-1], truth(), score=0.3) == ()


def test_pictures_without_labels_in_which_a_spacecraft_is_found_are_told() -> None:
    assert said(truth(), truth(), lacking=4) == ()
    assert "sure of a spacecraft in 9 of 9 pictures without one" in said(truth(), truth(), lacking=9)[0]
    assert len(said(truth(), truth(), lacking=COUNT)) == 1


def test_a_few_boxes_of_another_size_are_the_detectors_and_not_the_labels() -> None:
    right = truth()
    found = right.copy()
    found[:3] = right[:3] + 0.5 * (right[:3] - right[:3][:, [2, 3, 0, 1]])  # twice the sides
    assert said(right, found) == ()


def test_exchanged_sides_are_told_where_most_labels_agree_nevertheless() -> None:
    right = truth()
    middle, width = (right[:, :2] + right[:, 2:]) / 2, (right[:, 2:] - right[:, :2]).min(axis=1, keepdims=True)
    for ratio, count in ((1.4, 1), (1.05, 0)):
        half = width * np.array([ratio, 1.0]) / 2
        long = np.concatenate([middle - half, middle + half], axis=1)
        assert said(long, long) == ()
        sentences = said(exchanged_sides(long), long)
        assert len(sentences) == count
        assert all(each.endswith("would agree more if width and height were exchanged") for each in sentences)
