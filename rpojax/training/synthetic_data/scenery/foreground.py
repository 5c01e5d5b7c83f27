"""What lies between a camera and its scene: structure at the frame's edge, and reflections in a window."""

import cv2
import numpy as np

Rng = np.random.Generator


def add_structure(rng: Rng, image: np.ndarray) -> np.ndarray:
    """A linear image (p, p, 3) with an out-of-focus piece of the camera's own vehicle at one edge of the frame."""
    size = image.shape[0]
    depth = rng.uniform(-0.05, 0.3, 2) * size
    outline = np.array([[-2.0, -2.0], [size + 2.0, -2.0], [size + 2.0, depth[1]], [-2.0, depth[0]]])
    cover = np.zeros((size, size), np.float32)
    cv2.fillPoly(cover, [np.round(outline).astype(np.int32)], 1.0)
    for _ in range(int(rng.integers(0, 4))):  # gaps of a truss, or of a window's frame
        start, end = (tuple(int(v) for v in rng.uniform(0.0, 1.0, 2) * [size, 0.3 * size]) for _ in range(2))
        cv2.line(cover, start, end, 0.0, int(rng.integers(1, 6)))
    light = float(np.exp(rng.uniform(np.log(0.01), np.log(0.9)))) * rng.uniform(0.8, 1.0, 3)
    stripes = 1.0 + rng.uniform(0.0, 0.5) * np.sign(np.sin(np.arange(size) * rng.uniform(0.1, 1.5)))
    color = (stripes[None, :, None] * light * np.ones((size, 1, 1))).astype(np.float32)
    turns = int(rng.integers(4))
    cover, color = np.rot90(cover, turns), np.rot90(color, turns)
    blur = float(rng.uniform(0.4, 2.5))
    cover = cv2.GaussianBlur(np.ascontiguousarray(cover), (0, 0), blur)[..., None]
    return image * (1.0 - cover) + np.ascontiguousarray(color) * cover


def add_reflections(rng: Rng, image: np.ndarray) -> np.ndarray:
    """A linear image (p, p, 3) with soft patches of light that a window reflects."""
    size = image.shape[0]
    for _ in range(int(rng.integers(1, 4))):
        patch = np.zeros((size, size), np.float32)
        center = tuple(int(v) for v in rng.uniform(0.0, size, 2))
        axes = tuple(int(v) for v in np.exp(rng.uniform(np.log(0.02), np.log(0.4), 2)) * size + 1)
        cv2.ellipse(patch, center, axes, float(rng.uniform(0.0, 180.0)), 0.0, 360.0, 1.0, -1)
        if rng.random() < 0.5:
            patch -= cv2.erode(patch, np.ones((3, 3)), iterations=int(rng.integers(1, 5)))  # a rim only
        patch = cv2.GaussianBlur(patch, (0, 0), float(rng.uniform(0.8, 6.0)))
        light = float(np.exp(rng.uniform(np.log(0.004), np.log(0.15)))) * rng.uniform(0.6, 1.0, 3)
        image = image + patch[..., None] * light.astype(np.float32)
    return image
