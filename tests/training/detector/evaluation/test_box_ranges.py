"""Ranges of boxes by size and contrast."""

import numpy as np
import pytest

from rpojax.training.detector.average_precision import box_contrast, outside_contrast_range, outside_size_range


def test_contrast_is_the_difference_of_mean_codes() -> None:
    image = np.full((64, 64, 3), 50, np.uint8)
    image[20:40, 10:40] = (90, 60, 50)
    box = np.array([10.0, 20.0, 40.0, 40.0])
    assert box_contrast(image, box) == pytest.approx(40.0)
    flags = outside_contrast_range(25.0, 60.0)(image, box[None])
    assert not flags[0]
    assert outside_contrast_range(0.0, 25.0)(image, box[None])[0]


def test_boxes_outside_of_a_range_of_sizes() -> None:
    boxes = np.array([[0.0, 0.0, 10.0, 4.0], [0.0, 0.0, 10.0, 20.0], [0.0, 0.0, 30.0, 20.0]])
    image = np.zeros((64, 64, 3), np.uint8)
    assert outside_size_range(16.0, 24.0)(image, boxes).tolist() == [True, False, True]
