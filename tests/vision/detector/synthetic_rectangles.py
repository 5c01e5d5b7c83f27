"""Images of bright rectangles, and their boxes found by brightness."""

import cv2
import numpy as np


def bright_boxes(pixels: np.ndarray) -> list[list[int]]:
    """Boxes of connected bright pixels in an image, of at least 6 px."""
    count, _, stats, _ = cv2.connectedComponentsWithStats((pixels.max(axis=2) > 0.5).astype(np.uint8))
    corners = [(x, y, w, h) for x, y, w, h, _ in stats[1:count]]
    return [[x, y, x + w, y + h] for x, y, w, h in corners if max(w, h) >= 6]


def image_with_rectangles(height: int, width: int, *rectangles: tuple[int, int, int, int]) -> np.ndarray:
    """White rectangles (left, top, right, bottom) on black."""
    image = np.zeros((height, width, 3), np.float32)
    for left, top, right, bottom in rectangles:
        image[top:bottom, left:right] = 1.0
    return image
