"""Detection in images of any size: levels, duplicates and verification."""

import inspect

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from synthetic_rectangles import bright_boxes, image_with_rectangles

from rpojax.cli.options.vision import DetectCommand
from rpojax.vision.detector import multiscale_detection, sliding_windows
from rpojax.vision.detector.box_decoding import Detections
from rpojax.vision.detector.scored_box import ScoredBox, box_edges
from rpojax.vision.intersection_over_union import intersection_over_union


@pytest.fixture
def by_brightness(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replaces the detector by boxes of bright pixels."""

    def detect_bright(params: object, images: Array, count: int) -> Detections:
        boxes, scores = np.zeros((len(images), count, 4), np.float32), np.zeros((len(images), count), np.float32)
        for index, pixels in enumerate(np.asarray(images)):
            for place, box in enumerate(bright_boxes(pixels)[:count]):
                boxes[index, place], scores[index, place] = box, 0.9
        return Detections(box_px=jnp.asarray(boxes), score=jnp.asarray(scores))

    monkeypatch.setattr(multiscale_detection, "_detect", detect_bright)


@pytest.mark.parametrize(
    ("shape", "rectangle"),
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
def test_rectangle_is_found_once_at_its_place(
    by_brightness: None, shape: tuple[int, int], rectangle: tuple[int, int, int, int]
) -> None:
    boxes = multiscale_detection.detect_multiscale({}, image_with_rectangles(*shape, rectangle))
    assert len(boxes) == 1
    # Pixels of the image per pixel of the window.
    coarse = max(1.0, max(shape) / 2048, max(rectangle[2] - rectangle[0], rectangle[3] - rectangle[1]) / 44.0)
    np.testing.assert_allclose(box_edges(boxes), [rectangle], atol=1.5 * coarse)


def test_distant_rectangles_are_all_found_and_empty_image_has_none(by_brightness: None) -> None:
    rectangles = [(50, 60, 90, 85), (800, 640, 850, 660)]
    boxes = sorted(
        multiscale_detection.detect_multiscale({}, image_with_rectangles(700, 1000, *rectangles)),
        key=lambda box: box.left,
    )
    assert len(boxes) == 2
    assert (intersection_over_union(box_edges(boxes), np.array(rectangles)) > 0.8).all()
    assert multiscale_detection.detect_multiscale({}, image_with_rectangles(300, 400)) == []


def test_a_box_of_the_whole_image_is_dropped(by_brightness: None) -> None:
    full, most = (image_with_rectangles(160, 160, (edge, edge, 160 - edge, 160 - edge)) for edge in (0, 12))
    assert multiscale_detection.detect_multiscale({}, full) == []
    assert len(multiscale_detection.detect_multiscale({}, most)) == 1


def test_overlapping_boxes_of_one_level_are_both_kept_and_parts_of_finer_levels_are_not() -> None:
    large, beside, part = (
        ScoredBox(10.0, 10.0, 50.0, 40.0, 0.9),
        ScoredBox(40.0, 12.0, 80.0, 42.0, 0.8),
        ScoredBox(12.0, 12.0, 25.0, 30.0, 0.8),
    )
    assert not multiscale_detection._is_duplicate(beside, [large])
    assert multiscale_detection._is_duplicate(ScoredBox(12.0, 10.0, 52.0, 42.0, 0.7), [beside, large])
    assert multiscale_detection._is_part(part, [beside, large])
    assert not multiscale_detection._is_part(beside, [large])


def test_detection_in_one_view_only_is_rejected(by_brightness: None, monkeypatch: pytest.MonkeyPatch) -> None:
    detect_in_all = multiscale_detection._detect

    def detect_in_first(params: object, images: Array, count: int) -> Detections:
        found = detect_in_all(params, images, count)
        first = np.arange(len(images))[:, None] == 0  # the first window, and the view that is not mirrored
        return Detections(box_px=found.box_px, score=jnp.asarray(np.where(first, found.score, 0.01), jnp.float32))

    image = image_with_rectangles(64, 100, (30, 10, 60, 25))
    assert len(multiscale_detection.detect_multiscale({}, image)) == 1
    monkeypatch.setattr(multiscale_detection, "_detect", detect_in_first)
    assert multiscale_detection.detect_multiscale({}, image) == []
    assert len(multiscale_detection.detect_multiscale({}, image, threshold=0.001)) == 1


def test_command_line_has_same_default_threshold() -> None:
    assert inspect.signature(DetectCommand).parameters["threshold"].default == multiscale_detection.SCORE_THRESHOLD


@pytest.mark.parametrize("long_side", [1, 100, 128, 200, 300, 1024, 5000, 20_000])
def test_levels_go_from_one_window_to_finest_scale(long_side: int) -> None:
    levels = [side for sides in multiscale_detection._levels(long_side) for side in sides]
    assert sliding_windows.WINDOW_PX in levels
    assert levels == sorted(set(levels))
    assert levels[-1] <= multiscale_detection.MAX_SIDE_PX
    assert levels[-1] >= min(max(long_side, sliding_windows.WINDOW_PX), multiscale_detection.MAX_SIDE_PX) / 1.4
