"""Bounding box with a score, on the host."""

import dataclasses
from collections.abc import Sequence

import numpy as np


@dataclasses.dataclass(frozen=True)
class ScoredBox:
    """Left, top, right, bottom [px], and score in 0..1."""

    left: float
    top: float
    right: float
    bottom: float
    score: float


def box_edges(boxes: Sequence[ScoredBox]) -> np.ndarray:
    """Left, top, right, bottom (n, 4) [px] of boxes."""
    return np.array([[box.left, box.top, box.right, box.bottom] for box in boxes]).reshape(-1, 4)
