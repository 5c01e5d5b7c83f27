"""Calibration of the detector's score on empty images."""

import jax
import numpy as np
import pytest

from rpojax.training.detector.evaluate_detector import EMPTY_SHARE, calibrate_score, detect_images
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset
from rpojax.vision.detector.two_stage_detector import SCORE_THRESHOLD, DetectorParams, initialize

Z = np.zeros((0, 4), np.float32)


@pytest.fixture(scope="module")
def params() -> DetectorParams:
    return initialize(jax.random.key(0))


def data(empty: int) -> DetectionDataset:
    """Images of noise, the first ten with a spacecraft."""
    images = np.random.default_rng(0).integers(0, 256, (10 + empty, 32, 32, 3)).astype(np.uint8)
    boxes = (np.array([[4.0, 4.0, 20.0, 20.0]], np.float32),) * 10 + (Z,) * empty
    return DetectionDataset(images, boxes, ("noise",) * len(images))


def test_a_hundredth_of_the_empty_images_reaches_the_threshold(params: DetectorParams) -> None:
    images = data(150)
    before = detect_images(params, images.images)
    after = detect_images(calibrate_score(params, images), images.images)
    best = np.array([scores.max() for scores in after.scores[10:]])
    assert (best >= SCORE_THRESHOLD).mean() == pytest.approx(EMPTY_SHARE, abs=0.006)
    # Boxes stay the same, and so does the order of their scores.
    np.testing.assert_allclose(before.boxes[3][:1], after.boxes[3][:1], atol=1e-3)
    order = np.array([np.argsort([scores.max() for scores in found.scores]) for found in (before, after)])
    assert np.corrcoef(order)[0, 1] > 0.999


def test_few_empty_images_move_nothing(params: DetectorParams) -> None:
    assert calibrate_score(params, data(20)) is params
