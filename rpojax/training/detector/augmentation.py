"""Batches of augmented training images with boxes."""

import dataclasses

import numpy as np

from rpojax.training.detector.geometric_augmentation import augment_geometry, two_crops
from rpojax.training.detector.photometric_augmentation import NOISE_SIDE_PX, augment_appearance
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

Rng = np.random.Generator

MAX_BOXES = 8
_MIN_SIDE_PX = 4.0


@dataclasses.dataclass(frozen=True)
class Batch:
    """Images for one step of a training.

    Attributes:
        images: (n, p, p, 3) float32 sRGB codes in 0..1
        boxes: (n, MAX_BOXES, 4) float32 left, top, right, bottom [px]
        weight: (n, MAX_BOXES) 1 for a box to learn, 0 for none, -1 for one to ignore
    """

    images: np.ndarray
    boxes: np.ndarray
    weight: np.ndarray


def augment_batch(data: DetectionDataset, indices: np.ndarray, rng: Rng, crops: bool = False) -> Batch:
    """Images with the given indices, each augmented at random.

    With `crops` each becomes two of half the side: the whole image, shrunk, and a crop at full resolution.
    """
    noise = rng.normal(size=(NOISE_SIDE_PX, NOISE_SIDE_PX, 3)).astype(np.float32)
    images, boxes, weights = [], [], []
    for index in indices:
        image, found = augment_geometry(rng, data, int(index))
        for view, inside in two_crops(rng, image, found) if crops else ((image, found),):
            images.append(augment_appearance(rng, view, noise))
            box, weight = _pad_boxes(inside)
            boxes.append(box)
            weights.append(weight)
    return Batch(np.stack(images), np.stack(boxes), np.stack(weights))


def _pad_boxes(found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boxes and weights in arrays of fixed length, the largest boxes first; those of a few pixels are ignored."""
    side = np.max(found[:, 2:4] - found[:, :2], axis=1, initial=0.0)
    order = np.argsort(-side)[:MAX_BOXES]
    box, weight = np.zeros((MAX_BOXES, 4), np.float32), np.zeros(MAX_BOXES, np.float32)
    box[: len(order)] = found[order, :4]
    weight[: len(order)] = np.where(side[order] >= _MIN_SIDE_PX, found[order, 4], -1.0)
    return box, weight
