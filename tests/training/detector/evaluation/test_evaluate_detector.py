"""Metrics of worked detections."""

import numpy as np
import pytest

from rpojax.training.detector import evaluate_detector
from rpojax.training.detector.evaluate_detector import ImageDetections
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

SIZE = 128


def test_metrics_of_worked_detections() -> None:
    truth = (
        np.array([[10.0, 10.0, 40.0, 30.0]]),
        np.array([[50.0, 50.0, 90.0, 90.0], [5.0, 5.0, 12.0, 12.0]]),
        np.zeros((0, 4)),
        np.zeros((0, 4)),
    )
    data = DetectionDataset(np.zeros((4, SIZE, SIZE, 3), np.uint8), truth, ("black", "earth", "earth", "black"))
    found = ImageDetections(
        [truth[0], truth[1][1:], np.array([[0.0, 0.0, 30.0, 30.0]]), np.array([[0.0, 0.0, 30.0, 30.0]])],
        [np.array([0.9]), np.array([0.8]), np.array([0.7]), np.array([0.1])],
    )
    metrics = evaluate_detector.detection_metrics(found, data)
    assert metrics["boxes"] == 2  # the third is below 16 px and ignored
    assert metrics["recall"] == metrics["median_iou"] == 0.5
    assert metrics["map50"] == pytest.approx(51 / 101, abs=1e-4)
    assert metrics["false_alarms_per_empty_frame"] == 0.5  # one of two scores is above the threshold
    report = evaluate_detector.evaluation_report(found, data)
    assert report["by_size"]["0 to 8 px"]["recall"] == 1.0
    assert report["by_background"]["black"]["recall"] == 1.0
    assert report["by_background"]["earth"]["recall"] == 0.0
    # Two of two frames are empty of spacecraft, one of which has a box.
    assert report["interval_95"]["empty_frames_with_a_box"] == pytest.approx((0.0945, 0.9055), abs=1e-3)
    assert report["interval_95"]["recall"] == pytest.approx((0.0945, 0.9055), abs=1e-3)
    assert report["by_contrast"]["0 to 10 codes"]["boxes"] == 2  # all images are black
    assert report["pairs"]["near"]["images"] == 0
