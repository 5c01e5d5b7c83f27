"""Augmented batches: boxes follow the pixels, codes stay in range."""

import numpy as np
import pytest

from rpojax.training.detector import augmentation
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

SIZE = 128


@pytest.mark.parametrize("crops", [False, True])
def test_boxes_follow_pixels_through_geometric_augmentation(
    rectangles: DetectionDataset, crops: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unchanged(rng: object, image: np.ndarray, noise: object) -> np.ndarray:
        return image.astype(np.float32) / 255.0

    monkeypatch.setattr(augmentation, "augment_appearance", unchanged)
    batch = augmentation.augment_batch(rectangles, np.arange(39), np.random.default_rng(1), crops)
    side = SIZE // 2 if crops else SIZE
    assert batch.images.shape[1:] == (side, side, 3)
    assert len(batch.images) == (78 if crops else 39)
    checked = 0
    for image, boxes, weight in zip(batch.images, batch.boxes, batch.weight, strict=True):
        bright = image.max(axis=2) > 0.2
        for box in boxes[weight == 1.0]:
            left, top, right, bottom = np.round(box).astype(int)
            assert bright[top + 1 : bottom - 1, left + 1 : right - 1].all()
            checked += 1
        if (weight != 0.0).sum() == 1 and (weight == 1.0).any():
            rows, columns = (np.nonzero(bright.any(axis=axis))[0] for axis in (1, 0))
            box = boxes[weight == 1.0][0]
            edges = [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]
            np.testing.assert_allclose(edges, box, atol=1.5)  # interpolation spreads an edge over a pixel
    assert checked >= 39


def test_augmented_codes_are_in_range(rectangles: DetectionDataset) -> None:
    batch = augmentation.augment_batch(rectangles, np.arange(40), np.random.default_rng(2))
    assert batch.images.dtype == np.float32
    assert batch.images.min() >= 0.0
    assert batch.images.max() <= 1.0
    assert batch.weight[39].sum() == 0.0 or batch.weight[39].max() == 1.0  # empty, or in a mosaic


def test_masks_and_known_edges_follow_the_flips() -> None:
    image, mask = np.zeros((1, SIZE, SIZE, 3), np.uint8), np.zeros((1, SIZE, SIZE), np.uint8)
    image[0, 20:50, 30:90] = 200
    mask[0, 20:50, 30:90] = 255
    known = np.array([[True, False, False, False]])  # the left edge alone
    box = np.array([[30.0, 20.0, 90.0, 50.0]], np.float32)
    data = DetectionDataset(image, (box,), ("black",), (), (known,), mask)
    edges = set()
    for seed in range(40):
        view = augmentation._random_flip(np.random.default_rng(seed), augmentation.labelled_image(data, 0))
        np.testing.assert_array_equal(view.coverage > 0.5, view.codes[..., 0] > 100)
        # The known edge is one of the short sides, wherever it is now.
        left, top, right, bottom = view.boxes[0]
        short = ("left", "right") if right - left > bottom - top else ("top", "bottom")
        name = ("left", "top", "right", "bottom")[int(np.argmax(view.known[0]))]
        assert name in short
        assert view.known.sum() == 1
        edges.add(name)
    assert edges == {"left", "top", "right", "bottom"}


def test_data_without_masks_has_none_in_batches(rectangles: DetectionDataset) -> None:
    batch = augmentation.augment_batch(rectangles, np.arange(4), np.random.default_rng(3))
    assert (batch.mask == -1.0).all()
    assert batch.known[batch.weight > 0.0].min() == 1.0
