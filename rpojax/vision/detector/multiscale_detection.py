"""Spacecraft in a picture of any size: first the whole of it, then windows at ever finer scales.

Every window has the same size, and so does every batch of windows: one program serves all pictures.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.vision.detector.two_stage_detector import DetectorParams, detect

WINDOW_PX = 128
MAX_SIDE_PX = 2048
"""Long side at which a picture is searched at its finest; larger ones are shrunk to it."""
SCORE_THRESHOLD = 0.65
"""Score of all views together from which a box is told: a picture has many windows, and each may err."""
_CANDIDATE_SCORE = 0.4
"""Score in one window from which a box is looked at more closely."""
_COARSE_SIDE_PX = 72
"""Long side at which a picture is seen first, so that what fills it has room around it."""
_WINDOW_STEP_PX = 80
_BATCH = 16
_BOXES_PER_WINDOW = 4
_MAX_WINDOW_FRACTION = 0.55
_BORDER_PX = 2.0
_CONTAINED_FRACTION = 0.6
_DUPLICATE_IOU = 0.4
_VERIFICATION_SIDE_PX = 44.0
_MIRRORS = ((1, 1), (-1, 1), (1, -1), (-1, -1))
_MISSED_SCORE = 0.05
"""Score of a view that shows no such box."""

_detect = jax.jit(detect, static_argnums=2)


@dataclasses.dataclass(frozen=True)
class ScoredBox:
    """Left, top, right, bottom [px] in the picture, and score in 0..1."""

    left: float
    top: float
    right: float
    bottom: float
    score: float

    @property
    def area(self) -> float:
        """Area [px^2]."""
        return max(self.right - self.left, 0.0) * max(self.bottom - self.top, 0.0)

    def intersection_area(self, other: "ScoredBox") -> float:
        """Area [px^2] that two boxes share."""
        width = min(self.right, other.right) - max(self.left, other.left)
        height = min(self.bottom, other.bottom) - max(self.top, other.top)
        return max(width, 0.0) * max(height, 0.0)

    def intersection_over_union(self, other: "ScoredBox") -> float:
        """Intersection over union."""
        both = self.intersection_area(other)
        return both / max(self.area + other.area - both, 1e-9)


@dataclasses.dataclass(frozen=True)
class _Window:
    """A square of pixels (p, p, 3), its corner in the picture [px], and window pixels to a pixel of the picture."""

    pixels: np.ndarray
    left: float
    top: float
    scale: float


def detect_multiscale(params: DetectorParams, image: np.ndarray, threshold: float = SCORE_THRESHOLD) -> list[ScoredBox]:
    """Boxes of spacecraft in sRGB codes (h, w, 3) in 0..1, by falling score."""
    height, width = image.shape[:2]
    candidate_score = min(_CANDIDATE_SCORE, threshold)
    candidates: list[ScoredBox] = []
    for sides in _levels(max(height, width)):
        whole = max(sides) <= WINDOW_PX
        windows = [w for side in sides for w in _windows(image, min(side / max(height, width), 1.0))]
        for box in _by_falling_score(_detect_in_windows(params, windows, (height, width), candidate_score, whole)):
            if _is_new(box, candidates):
                candidates.append(box)
    verified: list[ScoredBox] = []
    for box in candidates:
        refined = _verify(params, image, box)
        if refined is not None and refined.score >= threshold and _is_new(refined, verified):
            verified.append(refined)
    return _by_falling_score(verified)


def _is_new(box: ScoredBox, coarser: list[ScoredBox]) -> bool:
    """Whether a box is neither one that is known nor a part of one: finer windows see parts of a large spacecraft."""
    return all(
        box.intersection_area(other) < _CONTAINED_FRACTION * box.area
        and box.intersection_over_union(other) < _DUPLICATE_IOU
        for other in coarser
    )


def _by_falling_score(boxes: list[ScoredBox]) -> list[ScoredBox]:
    return sorted(boxes, key=lambda box: -box.score)


def _levels(long_side: int) -> list[list[int]]:
    """Long sides [px] to search at: the whole picture in one window, twice where it is large, then ever finer ones."""
    finest = min(max(long_side, WINDOW_PX), MAX_SIDE_PX)
    levels = [WINDOW_PX]
    while levels[-1] * 2 <= finest:
        levels.append(levels[-1] * 2)
    if finest >= 1.4 * levels[-1]:
        levels.append(finest)
    first = [_COARSE_SIDE_PX, WINDOW_PX] if long_side > _COARSE_SIDE_PX else [WINDOW_PX]
    return [first, *([level] for level in levels[1:])]


def _windows(image: np.ndarray, scale: float) -> list[_Window]:
    """Overlapping windows that cover a picture at a scale; where it is narrower than one, its edge is continued."""
    import cv2

    height, width = image.shape[:2]
    sides = max(1, round(width * scale)), max(1, round(height * scale))
    small = image if scale == 1.0 else np.asarray(cv2.resize(image, sides, interpolation=cv2.INTER_AREA))
    low = [max(0, WINDOW_PX - n) // 2 for n in small.shape[:2]]
    high = [max(0, WINDOW_PX - n - before) for n, before in zip(small.shape[:2], low, strict=True)]
    padded = cv2.copyMakeBorder(small, low[0], high[0], low[1], high[1], cv2.BORDER_REPLICATE)
    windows = []
    for top in _starts(padded.shape[0]):
        for left in _starts(padded.shape[1]):
            pixels = padded[top : top + WINDOW_PX, left : left + WINDOW_PX]
            windows.append(_Window(pixels, (left - low[1]) / scale, (top - low[0]) / scale, scale))
    return windows


def _starts(length: int) -> list[int]:
    count = -(-(length - WINDOW_PX) // _WINDOW_STEP_PX) + 1
    return [round(i * (length - WINDOW_PX) / max(count - 1, 1)) for i in range(count)]


def _detect_in_windows(
    params: DetectorParams, windows: list[_Window], shape: tuple[int, int], threshold: float, whole: bool
) -> list[ScoredBox]:
    """Boxes in windows; those that a window cuts or that fill it are left to coarser windows, which see them whole."""
    boxes = []
    for start in range(0, len(windows), _BATCH):
        part = windows[start : start + _BATCH]
        pixels = np.zeros((_BATCH, WINDOW_PX, WINDOW_PX, 3), np.float32)
        pixels[: len(part)] = [window.pixels for window in part]
        result = _detect(params, jnp.asarray(pixels), _BOXES_PER_WINDOW)
        edges, scores = np.asarray(result.box_px), np.asarray(result.score)
        for window, found, score in zip(part, edges, scores, strict=False):
            for index in np.nonzero(score >= threshold)[0]:
                if whole or not _is_cut(window, found[index], shape):
                    boxes.append(_to_image_pixels(window, found[index], float(score[index]), shape))
    return [box for box in boxes if box.area > 0.0]


def _is_cut(window: _Window, edges: np.ndarray, shape: tuple[int, int]) -> bool:
    left, top, right, bottom = (float(edge) for edge in edges)
    side = WINDOW_PX / window.scale
    inner = (
        (left < _BORDER_PX and window.left > 0.5)
        or (top < _BORDER_PX and window.top > 0.5)
        or (right > WINDOW_PX - _BORDER_PX and window.left + side < shape[1] - 0.5)
        or (bottom > WINDOW_PX - _BORDER_PX and window.top + side < shape[0] - 0.5)
    )
    return inner or max(right - left, bottom - top) > _MAX_WINDOW_FRACTION * WINDOW_PX


def _to_image_pixels(window: _Window, edges: np.ndarray, score: float, shape: tuple[int, int]) -> ScoredBox:
    """A window's box in the picture, cut to it."""
    offset = np.array([window.left, window.top, window.left, window.top])
    high = np.array([shape[1], shape[0], shape[1], shape[0]], np.float64)
    left, top, right, bottom = np.clip(edges / window.scale + offset, 0.0, high)
    return ScoredBox(float(left), float(top), float(right), float(bottom), score)


def _verify(params: DetectorParams, image: np.ndarray, box: ScoredBox) -> ScoredBox | None:
    """The box as it is seen in a window around it and in that window's mirror images; None where none agrees.

    The odds of all views count alike: what is a spacecraft in one of them alone rarely is one.
    """
    window = _centered_window(image, box)
    pixels = np.zeros((_BATCH, WINDOW_PX, WINDOW_PX, 3), np.float32)
    for place, (across, down) in enumerate(_MIRRORS):
        pixels[place] = window.pixels[::down, ::across]
    result = _detect(params, jnp.asarray(pixels), _BOXES_PER_WINDOW)
    agreeing = []
    for place, mirror in enumerate(_MIRRORS):
        edges = _mirror_boxes(np.asarray(result.box_px[place], np.float64), mirror)
        scores = np.asarray(result.score[place], np.float64)
        seen = [_to_image_pixels(window, e, float(s), image.shape[:2]) for e, s in zip(edges, scores, strict=True)]
        seen = [other for other in seen if other.intersection_over_union(box) >= 0.5]
        agreeing += [max(seen, key=lambda other: other.score)] if seen else []
    if not agreeing:
        return None
    scores = [box.score, *(other.score for other in agreeing)]
    scores += [_MISSED_SCORE] * (1 + len(_MIRRORS) - len(scores))
    left, top, right, bottom = np.mean([[b.left, b.top, b.right, b.bottom] for b in agreeing], axis=0).tolist()
    return ScoredBox(left, top, right, bottom, _mean_log_odds_score(scores))


def _centered_window(image: np.ndarray, box: ScoredBox) -> _Window:
    """A window with a box in the middle, shrunk so that the box has a middling size at most."""
    import cv2

    height, width = image.shape[:2]
    long_side = max(box.right - box.left, box.bottom - box.top)
    side = WINDOW_PX / min(_VERIFICATION_SIDE_PX / long_side, 1.0)
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
    return _Window(np.asarray(pixels)[:WINDOW_PX, :WINDOW_PX], *corner, scale)


def _mirror_boxes(edges: np.ndarray, mirror: tuple[int, int]) -> np.ndarray:
    """Boxes (n, 4) of a mirrored window in the window itself, and the other way round."""
    left, top, right, bottom = edges.T
    if mirror[0] < 0:
        left, right = WINDOW_PX - right, WINDOW_PX - left
    if mirror[1] < 0:
        top, bottom = WINDOW_PX - bottom, WINDOW_PX - top
    return np.stack([left, top, right, bottom], axis=1)


def _mean_log_odds_score(scores: list[float]) -> float:
    """Score whose odds are the geometric mean of those of several."""
    values = np.clip(scores, 1e-6, 1.0 - 1e-6)
    return float(1.0 / (1.0 + np.exp(-np.mean(np.log(values / (1.0 - values))))))
