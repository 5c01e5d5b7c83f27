"""Sprites placed in an image: size, place and light at random, alone or two near each other."""

from collections.abc import Sequence

import cv2
import numpy as np

from rpojax.training.synthetic_data.spacecraft_sprites import Sprite

Rng = np.random.Generator
Layer = tuple[np.ndarray, np.ndarray]
"""Colour (p, p, 3), premultiplied and linear, and covered fraction (p, p)."""

_CUT_FRACTION = 0.1
_GAP_RANGE = (-0.5, 0.5)
"""Gap of two near spacecraft by the size of the smaller one; below 0 their boxes overlap."""


def random_layer(rng: Rng, sprite: Sprite, size_px: int, kind: str, is_target: bool) -> Layer:
    """A sprite at a random size and place, under random light."""
    side = random_side(rng, size_px, is_target)
    pixels, scale = _lit_pixels(rng, sprite, side, kind, is_target)
    width, height = _extent(sprite, scale)
    slack_x, slack_y = size_px - width, size_px - height
    corner = [rng.uniform(min(0.0, s), max(0.0, s)) for s in (slack_x, slack_y)]
    if rng.random() < _CUT_FRACTION:
        corner = [rng.uniform(-0.5 * extent, size_px - 0.5 * extent) for extent in (width, height)]
    return _placed(pixels, scale, corner, size_px)


def near_layers(rng: Rng, sprites: Sequence[Sprite], size_px: int, kind: str, is_target: bool) -> list[Layer]:
    """Two sprites side by side, with a gap of up to half of the smaller one's size, touching, or overlapping."""
    side = float(np.exp(rng.uniform(np.log(0.09), np.log(0.45)))) * size_px
    sides = [side, min(side * float(np.exp(rng.uniform(np.log(0.5), np.log(2.0)))), 0.5 * size_px)]
    lit = [_lit_pixels(rng, sprite, s, kind, is_target) for sprite, s in zip(sprites, sides, strict=True)]
    extents = np.array([_extent(sprite, scale) for sprite, (_, scale) in zip(sprites, lit, strict=True)])
    along, sign = int(rng.integers(2)), float(rng.choice([-1.0, 1.0]))
    offset = rng.uniform(-0.45, 0.45, 2) * extents.sum(axis=0)
    gap = rng.uniform(*_GAP_RANGE) * extents[:, along].min()
    offset[along] = sign * (0.5 * extents[:, along].sum() + gap)
    corners = np.stack([-0.5 * extents[0], offset - 0.5 * extents[1]])
    low, high = corners.min(axis=0), (corners + extents).max(axis=0)
    slack = size_px - (high - low)
    shift = [rng.uniform(min(0.0, s), max(0.0, s)) for s in slack] - low
    return [
        _placed(pixels, scale, list(corner + shift), size_px)
        for (pixels, scale), corner in zip(lit, corners, strict=True)
    ]


def _lit_pixels(rng: Rng, sprite: Sprite, side: float, kind: str, is_target: bool) -> tuple[np.ndarray, float]:
    """Premultiplied colour and alpha (h, w, 4) of a sprite under random light, and its scale to a long side [px]."""
    sun, shine = _random_light(rng, kind, is_target)
    tint = np.array([1.0, 1.0, 1.0]) if is_target else 1.0 + rng.normal(scale=0.08, size=3)
    color = (sun * sprite.sunlit + shine * sprite.earth_shine) * tint.astype(np.float32)
    pixels = np.concatenate([np.minimum(color, 4.0), sprite.alpha[..., None]], axis=2).astype(np.float32)
    return pixels, side / max(sprite.alpha.shape)


def _extent(sprite: Sprite, scale: float) -> tuple[float, float]:
    """Width and height [px] of a sprite at a scale."""
    height, width = sprite.alpha.shape
    return scale * width, scale * height


def _placed(pixels: np.ndarray, scale: float, corner: list[float], size_px: int) -> Layer:
    resampled = _resample(pixels, scale, corner, size_px)
    return resampled[..., :3], np.clip(resampled[..., 3], 0.0, 1.0)


def random_side(rng: Rng, size_px: int, is_target: bool) -> float:
    """Random long side [px] of a spacecraft; most are 10 to 60 of 128 px, of the packaged target 13 to 45."""
    if is_target and rng.random() < 0.75:
        return float(np.exp(rng.uniform(np.log(0.1), np.log(0.36)))) * size_px
    if rng.random() < 0.55:
        return float(np.exp(rng.uniform(np.log(0.08), np.log(0.5)))) * size_px
    return float(np.exp(rng.uniform(np.log(0.06), np.log(1.15)))) * size_px


def _random_light(rng: Rng, kind: str, is_target: bool) -> tuple[float, float]:
    """Random irradiance of the Sun and of uniform light; before a bright background sometimes hardly any."""
    if is_target:
        return float(np.exp(rng.normal(scale=0.25))), float(rng.choice([0.0, 0.0, rng.uniform(0.0, 0.1)]))
    bright = kind in ("earth", "limb", "glint", "moon")
    if bright and rng.random() < 0.2:
        return float(rng.choice([0.0, rng.uniform(0.0, 0.05)])), float(rng.uniform(0.0, 0.03))
    sun = float(np.exp(rng.uniform(np.log(0.4), np.log(2.5))))
    return sun, sun * float(np.exp(rng.uniform(np.log(0.01), np.log(0.5 if bright else 0.25))))


def _resample(pixels: np.ndarray, scale: float, corner: list[float], size_px: int) -> np.ndarray:
    """Premultiplied pixels (h, w, c) resampled by a scale, with their upper left corner [px] in a canvas."""
    fine = 2
    # Area averaging to nearly the final size first, against aliasing in the exact resampling that follows.
    rough = [max(1, int(np.ceil(n * min(1.0, scale * fine)))) for n in pixels.shape[:2]]
    small = cv2.resize(pixels, rough[::-1], interpolation=cv2.INTER_AREA)
    ratio = [fine * scale * n / r for n, r in zip(pixels.shape[:2], rough, strict=True)]
    shift = [fine * c + 0.5 * r - 0.5 for c, r in zip(corner, ratio[::-1], strict=True)]
    matrix = np.array([[ratio[1], 0.0, shift[0]], [0.0, ratio[0], shift[1]]])
    canvas = cv2.warpAffine(np.asarray(small), matrix, (fine * size_px, fine * size_px), flags=cv2.INTER_LINEAR)
    return np.asarray(cv2.resize(canvas, (size_px, size_px), interpolation=cv2.INTER_AREA))
