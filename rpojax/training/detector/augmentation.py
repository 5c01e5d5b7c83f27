"""Batches of augmented training images with boxes."""

from typing import Any

import numpy as np

from rpojax.core.pytree import pytree
from rpojax.training.detector.evaluation.box_ranges import long_side
from rpojax.training.detector.geometric_augmentation import LabelledImage, augment_geometry, two_crops
from rpojax.training.detector.photometric_augmentation import NOISE_SIDE_PX, augment_appearance
from rpojax.training.synthetic_data.detection_dataset import DetectionDataset

Rng = np.random.Generator

MAX_BOXES = 8
_MIN_SIDE_PX = 4.0


@pytree
class Batch:
    """Images for one step of a training, in arrays of NumPy on the host and of JAX in the step.

    Attributes:
        images: (n, p, p, 3) float32 sRGB codes in 0..1
        boxes: (n, MAX_BOXES, 4) float32 left, top, right, bottom [px]
        weight: (n, MAX_BOXES) 1 for a box to learn, 0 for none, -1 for one to ignore
        known: (n, MAX_BOXES, 4) 1 for an edge that the image shows, else 0
        mask: (n, p, p) fraction 0..1 of each pixel that visible spacecraft cover, -1 where nobody knows
    """

    images: Any
    boxes: Any
    weight: Any
    known: Any
    mask: Any


def augment_batch(data: DetectionDataset, indices: np.ndarray, rng: Rng, crops: bool = False) -> Batch:
    """Images with the given indices, each augmented at random.

    With `crops` each becomes two of half the side: the whole image, shrunk, and a crop at full resolution.
    """
    noise = rng.normal(size=(NOISE_SIDE_PX, NOISE_SIDE_PX, 3)).astype(np.float32)
    images, labels, masks = [], [], []
    for index in indices:
        view = augment_geometry(rng, data, int(index))
        for part in two_crops(rng, view) if crops else (view,):
            images.append(augment_appearance(rng, part.codes, noise))
            labels.append(_padded_labels(part))
            masks.append(part.coverage)
    boxes, weight, known = (np.stack(arrays) for arrays in zip(*labels, strict=True))
    return Batch(images=np.stack(images), boxes=boxes, weight=weight, known=known, mask=np.stack(masks))


def _padded_labels(view: LabelledImage) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Boxes, weights and known edges in arrays of fixed length, the largest boxes first; tiny ones are ignored."""
    side = long_side(view.boxes)
    order = np.argsort(-side)[:MAX_BOXES]
    box, weight = np.zeros((MAX_BOXES, 4), np.float32), np.zeros(MAX_BOXES, np.float32)
    known = np.zeros((MAX_BOXES, 4), np.float32)
    box[: len(order)], known[: len(order)] = view.boxes[order], view.known[order]
    weight[: len(order)] = np.where(side[order] >= _MIN_SIDE_PX, view.weight[order], -1.0)
    return box, weight, known
