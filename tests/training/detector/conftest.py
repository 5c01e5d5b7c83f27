"""Synthetic images of bright rectangles with their boxes."""

import numpy as np
import pytest

from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

SIZE = 128


@pytest.fixture(scope="session")
def rectangles() -> DetectionDataset:
    """40 images with a bright rectangle on black, the last one empty."""
    rng = np.random.default_rng(0)
    images, boxes = np.zeros((40, SIZE, SIZE, 3), np.uint8), []
    for image in images[:-1]:
        width, height = rng.integers(12, 60, 2)
        x, y = rng.integers(0, SIZE - width), rng.integers(0, SIZE - height)
        image[y : y + height, x : x + width] = rng.integers(120, 256, 3)
        boxes.append(np.array([[x, y, x + width, y + height]], np.float32))
    return DetectionDataset(images, (*boxes, np.zeros((0, 4), np.float32)), ("black",) * 40)
