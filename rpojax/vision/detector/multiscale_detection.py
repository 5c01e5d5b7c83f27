"""Detection in an image of any size: windows of fixed size at ever finer scales, then verification of each box.

All batches of windows have one shape, so that one compiled program serves all images.
"""

import jax
import jax.numpy as jnp
import numpy as np

from rpojax.vision.detector.scored_box import ScoredBox, box_edges
from rpojax.vision.detector.sliding_windows import (
    WINDOW_PX,
    Window,
    centered_window,
    is_cut,
    mirror_boxes,
    tile_windows,
    to_image_pixels,
)
from rpojax.vision.detector.two_stage_detector import DetectorParams, detect
from rpojax.vision.intersection_over_union import box_area, intersection_area, intersection_over_union

MAX_SIDE_PX = 2048
"""Long side of the finest scale; larger images are shrunk to it."""
SCORE_THRESHOLD = 0.5
"""Least score of a verified box, which is that of five views."""
_CANDIDATE_SCORE = 0.4
"""Least score in one window of a box to verify."""
_COARSE_SIDE_PX = 72
"""Long side of the coarsest scale, at which a spacecraft that fills the image has room around it."""
_BATCH = 16
_BOXES_PER_WINDOW = 4
_CONTAINED_FRACTION = 0.6
_DUPLICATE_IOU = 0.4
_MOST_OF_IMAGE = 0.95
"""Fraction of an image from which a box on it locates nothing: such boxes are mostly clouds that fill the image."""
_MIRRORS = ((1, 1), (-1, 1), (1, -1), (-1, -1))
_MISSED_SCORE = 0.05
"""Score of a view without the box."""

_detect = jax.jit(detect, static_argnums=2)


def detect_multiscale(params: DetectorParams, image: np.ndarray, threshold: float = SCORE_THRESHOLD) -> list[ScoredBox]:
    """Boxes of spacecraft in an image (h, w, 3) of sRGB codes in 0..1, by falling score; none of the whole image."""
    height, width = image.shape[:2]
    candidate_score = min(_CANDIDATE_SCORE, threshold)
    candidates: list[ScoredBox] = []
    for sides in _levels(max(height, width)):
        whole = max(sides) <= WINDOW_PX
        windows = [w for side in sides for w in tile_windows(image, min(side / max(height, width), 1.0))]
        coarser = list(candidates)
        for box in _by_falling_score(_detect_in_windows(params, windows, (height, width), candidate_score, whole)):
            if _locates(box, image) and not _is_part(box, coarser) and not _is_duplicate(box, candidates):
                candidates.append(box)
    verified: list[ScoredBox] = []
    for box in candidates:
        refined = _verify(params, image, box)
        if refined is None or refined.score < threshold or not _locates(refined, image):
            continue
        if not _is_duplicate(refined, verified):
            verified.append(refined)
    return _by_falling_score(verified)


def _locates(box: ScoredBox, image: np.ndarray) -> bool:
    """Whether a box says where in an image a spacecraft is: it is not nearly the whole image."""
    return float(box_area(box_edges([box]))[0]) < _MOST_OF_IMAGE * image.shape[0] * image.shape[1]


def _is_part(box: ScoredBox, coarser: list[ScoredBox]) -> bool:
    """Whether a box lies in one of a coarser level: fine windows show parts of large spacecraft."""
    edges = box_edges([box])
    inside = intersection_area(edges, box_edges(coarser)) >= _CONTAINED_FRACTION * box_area(edges)
    return bool(inside.any())


def _is_duplicate(box: ScoredBox, others: list[ScoredBox]) -> bool:
    """Whether a box is nearly one of others; two spacecraft that touch or overlap are not."""
    return bool((intersection_over_union(box_edges([box]), box_edges(others)) >= _DUPLICATE_IOU).any())


def _by_falling_score(boxes: list[ScoredBox]) -> list[ScoredBox]:
    return sorted(boxes, key=lambda box: -box.score)


def _levels(long_side: int) -> list[list[int]]:
    """Long sides [px] of the image by level: one or two at which it fits one window, then ever finer ones."""
    finest = min(max(long_side, WINDOW_PX), MAX_SIDE_PX)
    levels = [WINDOW_PX]
    while levels[-1] * 2 <= finest:
        levels.append(levels[-1] * 2)
    if finest >= 1.4 * levels[-1]:
        levels.append(finest)
    first = [_COARSE_SIDE_PX, WINDOW_PX] if long_side > _COARSE_SIDE_PX else [WINDOW_PX]
    return [first, *([level] for level in levels[1:])]


def _detect_in_windows(
    params: DetectorParams, windows: list[Window], shape: tuple[int, int], threshold: float, whole: bool
) -> list[ScoredBox]:
    """Boxes in windows, without those that a window cuts or that fill it, which coarser windows show whole."""
    boxes = []
    for start in range(0, len(windows), _BATCH):
        part = windows[start : start + _BATCH]
        pixels = np.zeros((_BATCH, WINDOW_PX, WINDOW_PX, 3), np.float32)
        pixels[: len(part)] = [window.pixels for window in part]
        result = _detect(params, jnp.asarray(pixels), _BOXES_PER_WINDOW)
        edges, scores = np.asarray(result.box_px), np.asarray(result.score)
        for window, found, score in zip(part, edges, scores, strict=False):
            for index in np.nonzero(score >= threshold)[0]:
                if whole or not is_cut(window, found[index], shape):
                    boxes.append(to_image_pixels(window, found[index], float(score[index]), shape))
    return [box for box, area in zip(boxes, box_area(box_edges(boxes)), strict=True) if area > 0.0]


def _verify(params: DetectorParams, image: np.ndarray, box: ScoredBox) -> ScoredBox | None:
    """Mean box over a window centred on it and its mirror images, with the score of all views; None without agreement.

    The log-odds of all views count alike, which suppresses boxes found in one view only.
    """
    window = centered_window(image, box)
    pixels = np.zeros((_BATCH, WINDOW_PX, WINDOW_PX, 3), np.float32)
    for place, (across, down) in enumerate(_MIRRORS):
        pixels[place] = window.pixels[::down, ::across]
    result = _detect(params, jnp.asarray(pixels), _BOXES_PER_WINDOW)
    agreeing = []
    for place, mirror in enumerate(_MIRRORS):
        edges = mirror_boxes(np.asarray(result.box_px[place], np.float64), mirror)
        scores = np.asarray(result.score[place], np.float64)
        boxes = [to_image_pixels(window, e, float(s), image.shape[:2]) for e, s in zip(edges, scores, strict=True)]
        overlaps = intersection_over_union(box_edges(boxes), box_edges([box]))
        boxes = [other for other, overlap in zip(boxes, overlaps, strict=True) if overlap >= 0.5]
        agreeing += [max(boxes, key=lambda other: other.score)] if boxes else []
    if not agreeing:
        return None
    scores = [box.score, *(other.score for other in agreeing)]
    scores += [_MISSED_SCORE] * (1 + len(_MIRRORS) - len(scores))
    left, top, right, bottom = np.mean(box_edges(agreeing), axis=0).tolist()
    return ScoredBox(left, top, right, bottom, _mean_log_odds_score(scores))


def _mean_log_odds_score(scores: list[float]) -> float:
    """Score whose log-odds are the mean of those of several scores."""
    values = np.clip(scores, 1e-6, 1.0 - 1e-6)
    return float(1.0 / (1.0 + np.exp(-np.mean(np.log(values / (1.0 - values))))))
