"""Square windows of fixed size over an image of any size, and boxes in their pixels."""

import dataclasses

import cv2
import numpy as np

from rpojax.vision.detector.scored_box import ScoredBox

WINDOW_PX = 128
_WINDOW_STEP_PX = 80
_MAX_WINDOW_FRACTION = 0.55
_BORDER_PX = 2.0
_CENTERED_SIDE_PX = 44.0
"""Largest long side of a box in a window centred on it."""


@dataclasses.dataclass(frozen=True)
class Window:
    """A square of pixels (p, p, 3), its corner in the image [px], and window pixels per pixel of the image."""

    pixels: np.ndarray
    left: float
    top: float
    scale: float


def tile_windows(image: np.ndarray, scale: float) -> list[Window]:
    """Overlapping windows that cover an image at a scale; a side shorter than a window is padded by its edge."""
    height, width = image.shape[:2]
    sides = max(1, round(width * scale)), max(1, round(height * scale))
    small = image if scale == 1.0 else np.asarray(cv2.resize(image, sides, interpolation=cv2.INTER_AREA))
    low = [max(0, WINDOW_PX - n) // 2 for n in small.shape[:2]]
    high = [max(0, WINDOW_PX - n - before) for n, before in zip(small.shape[:2], low, strict=True)]
    padded = cv2.copyMakeBorder(small, low[0], high[0], low[1], high[1], cv2.BORDER_REPLICATE)
    windows = []
    for top in window_starts(padded.shape[0]):
        for left in window_starts(padded.shape[1]):
            pixels = padded[top : top + WINDOW_PX, left : left + WINDOW_PX]
            windows.append(Window(pixels, (left - low[1]) / scale, (top - low[0]) / scale, scale))
    return windows


def window_starts(length: int) -> list[int]:
    """First pixels of evenly spaced windows over a length [px]."""
    count = -(-(length - WINDOW_PX) // _WINDOW_STEP_PX) + 1
    return [round(i * (length - WINDOW_PX) / max(count - 1, 1)) for i in range(count)]


def centered_window(image: np.ndarray, box: ScoredBox) -> Window:
    """A window centred on a box, shrunk so that the box fills at most a third of its side."""
    height, width = image.shape[:2]
    long_side = max(box.right - box.left, box.bottom - box.top)
    side = WINDOW_PX / min(_CENTERED_SIDE_PX / long_side, 1.0)
    left = 0.5 * (box.left + box.right) - 0.5 * side
    top = 0.5 * (box.top + box.bottom) - 0.5 * side
    first = [int(np.floor(max(v, 0.0))) for v in (left, top)]
    last = [int(np.ceil(min(v + side, n))) for v, n in ((left, width), (top, height))]
    piece = image[first[1] : last[1], first[0] : last[0]]
    scale = WINDOW_PX / side
    sides = [max(1, round(n * scale)) for n in piece.shape[1::-1]]
    small = np.asarray(cv2.resize(piece, sides, interpolation=cv2.INTER_AREA))[:WINDOW_PX, :WINDOW_PX]
    pad_left, pad_top = (max(0, min(WINDOW_PX - n, round(-v * scale))) for n, v in zip(sides, (left, top), strict=True))
    rest = WINDOW_PX - small.shape[0] - pad_top, WINDOW_PX - small.shape[1] - pad_left
    pixels = cv2.copyMakeBorder(small, pad_top, max(rest[0], 0), pad_left, max(rest[1], 0), cv2.BORDER_REPLICATE)
    corner = first[0] - pad_left / scale, first[1] - pad_top / scale
    return Window(np.asarray(pixels)[:WINDOW_PX, :WINDOW_PX], *corner, scale)


def is_cut(window: Window, edges: np.ndarray, shape: tuple[int, int]) -> bool:
    """Whether a box touches an edge of the window inside the image, or nearly fills the window."""
    left, top, right, bottom = (float(edge) for edge in edges)
    side = WINDOW_PX / window.scale
    inner = (
        (left < _BORDER_PX and window.left > 0.5)
        or (top < _BORDER_PX and window.top > 0.5)
        or (right > WINDOW_PX - _BORDER_PX and window.left + side < shape[1] - 0.5)
        or (bottom > WINDOW_PX - _BORDER_PX and window.top + side < shape[0] - 0.5)
    )
    return inner or max(right - left, bottom - top) > _MAX_WINDOW_FRACTION * WINDOW_PX


def to_image_pixels(window: Window, edges: np.ndarray, score: float, shape: tuple[int, int]) -> ScoredBox:
    """Box of a window in the image, clipped to it."""
    offset = np.array([window.left, window.top, window.left, window.top])
    high = np.array([shape[1], shape[0], shape[1], shape[0]], np.float64)
    left, top, right, bottom = np.clip(edges / window.scale + offset, 0.0, high)
    return ScoredBox(float(left), float(top), float(right), float(bottom), score)


def mirror_boxes(edges: np.ndarray, mirror: tuple[int, int]) -> np.ndarray:
    """Boxes (n, 4) of a window in its mirror image; its own inverse."""
    left, top, right, bottom = edges.T
    if mirror[0] < 0:
        left, right = WINDOW_PX - right, WINDOW_PX - left
    if mirror[1] < 0:
        top, bottom = WINDOW_PX - bottom, WINDOW_PX - top
    return np.stack([left, top, right, bottom], axis=1)
