"""A picture of any size is searched whole and in windows; what windows see comes together in its own pixels."""

import inspect
import itertools

import cv2
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from rpojax.cli.commands.detect import detect
from rpojax.vision.detector import multiscale_detection, sliding_windows
from rpojax.vision.detector.box_decoding import Detections
from rpojax.vision.detector.scored_box import ScoredBox


def bright_boxes(pixels: np.ndarray) -> list[list[int]]:
    """Left, top, right, bottom of everything bright in a window, from 6 px on."""
    count, _, stats, _ = cv2.connectedComponentsWithStats((pixels.max(axis=2) > 0.5).astype(np.uint8))
    corners = [(x, y, w, h) for x, y, w, h, _ in stats[1:count]]
    return [[x, y, x + w, y + h] for x, y, w, h in corners if max(w, h) >= 6]


@pytest.fixture
def by_brightness(monkeypatch: pytest.MonkeyPatch) -> None:
    """In place of the network: the boxes of what is bright."""

    def found(params: object, images: Array, count: int) -> Detections:
        boxes, scores = np.zeros((len(images), count, 4), np.float32), np.zeros((len(images), count), np.float32)
        for index, pixels in enumerate(np.asarray(images)):
            for place, box in enumerate(bright_boxes(pixels)[:count]):
                boxes[index, place], scores[index, place] = box, 0.9
        return Detections(box_px=jnp.asarray(boxes), score=jnp.asarray(scores))

    monkeypatch.setattr(multiscale_detection, "_detect", found)


def picture(height: int, width: int, *plates: tuple[int, int, int, int]) -> np.ndarray:
    image = np.zeros((height, width, 3), np.float32)
    for left, top, right, bottom in plates:
        image[top:bottom, left:right] = 1.0
    return image


@pytest.mark.parametrize(
    ("shape", "plate"),
    [
        ((128, 128), (30, 40, 60, 55)),
        ((64, 100), (30, 10, 60, 25)),
        ((700, 1000), (610, 333, 628, 345)),
        ((1000, 700), (100, 100, 600, 900)),
        ((3000, 2000), (1500, 2900, 1560, 2960)),
        ((90, 1500), (800, 20, 860, 50)),
        ((500, 500), (0, 200, 40, 230)),
    ],
)
def test_a_plate_is_found_once_in_its_own_pixels(
    by_brightness: None, shape: tuple[int, int], plate: tuple[int, int, int, int]
) -> None:
    boxes = multiscale_detection.detect_multiscale({}, picture(*shape, plate))
    assert len(boxes) == 1
    # A pixel of the window in which it was seen is at most so many of the picture's.
    coarse = max(1.0, max(shape) / 2048, max(plate[2] - plate[0], plate[3] - plate[1]) / 44.0)
    box = boxes[0]
    np.testing.assert_allclose([box.left, box.top, box.right, box.bottom], plate, atol=1.5 * coarse)


def test_plates_far_apart_are_each_found_and_an_empty_picture_has_none(by_brightness: None) -> None:
    plates = [(50, 60, 90, 85), (800, 640, 850, 660)]
    boxes = sorted(multiscale_detection.detect_multiscale({}, picture(700, 1000, *plates)), key=lambda box: box.left)
    assert len(boxes) == 2
    for plate, box in zip(plates, boxes, strict=True):
        assert box.intersection_over_union(ScoredBox(*(float(edge) for edge in plate), score=1.0)) > 0.8
    assert multiscale_detection.detect_multiscale({}, picture(300, 400)) == []


def test_what_is_seen_in_one_view_alone_is_no_box(by_brightness: None, monkeypatch: pytest.MonkeyPatch) -> None:
    everywhere = multiscale_detection._detect

    def once(params: object, images: Array, count: int) -> Detections:
        found = everywhere(params, images, count)
        first = np.arange(len(images))[:, None] == 0  # of the windows, and of the views the one that is not mirrored
        return Detections(box_px=found.box_px, score=jnp.asarray(np.where(first, found.score, 0.01), jnp.float32))

    image = picture(64, 100, (30, 10, 60, 25))
    assert len(multiscale_detection.detect_multiscale({}, image)) == 1
    monkeypatch.setattr(multiscale_detection, "_detect", once)
    assert multiscale_detection.detect_multiscale({}, image) == []
    assert len(multiscale_detection.detect_multiscale({}, image, threshold=0.001)) == 1


@pytest.mark.parametrize("mirror", multiscale_detection._MIRRORS)
def test_boxes_of_a_mirrored_window_come_back(mirror: tuple[int, int]) -> None:
    image = picture(sliding_windows.WINDOW_PX, sliding_windows.WINDOW_PX, (20, 30, 60, 44))
    seen = bright_boxes(image[:: mirror[1], :: mirror[0]])
    np.testing.assert_array_equal(sliding_windows._mirror_boxes(np.array(seen, float), mirror), [[20, 30, 60, 44]])


def test_the_verb_tells_boxes_from_the_same_score_on() -> None:
    assert inspect.signature(detect).parameters["threshold"].default == multiscale_detection.SCORE_THRESHOLD


@pytest.mark.parametrize("long_side", [1, 100, 128, 200, 300, 1024, 5000, 20_000])
def test_levels_go_from_one_window_to_the_finest(long_side: int) -> None:
    levels = [side for sides in multiscale_detection._levels(long_side) for side in sides]
    assert sliding_windows.WINDOW_PX in levels
    assert levels == sorted(set(levels))
    assert levels[-1] <= multiscale_detection.MAX_SIDE_PX
    assert levels[-1] >= min(max(long_side, sliding_windows.WINDOW_PX), multiscale_detection.MAX_SIDE_PX) / 1.4


@pytest.mark.parametrize("length", [128, 129, 200, 208, 209, 1000])
def test_windows_cover_every_pixel_and_overlap(length: int) -> None:
    starts = sliding_windows._starts(length)
    assert starts[0] == 0
    assert starts[-1] == length - sliding_windows.WINDOW_PX
    assert all(0 < b - a <= sliding_windows.WINDOW_PX - 40 for a, b in itertools.pairwise(starts))


def test_shares_and_overlaps_are_as_worked_by_hand() -> None:
    a, b = ScoredBox(0.0, 0.0, 2.0, 2.0, 1.0), ScoredBox(1.0, 1.0, 3.0, 2.0, 1.0)
    assert (a.area, a.intersection_area(b)) == (4.0, 1.0)
    assert a.intersection_over_union(b) == pytest.approx(1 / 5)
