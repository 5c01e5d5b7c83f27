"""Random composites of sprites and backdrops, with the boxes of the spacecraft in them."""

import dataclasses
from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from rpojax.training.synthetic_data.image_sensor import ImageSensor, add_artefacts, expose_image
from rpojax.training.synthetic_data.meshes.packaged_target import PACKAGED_TARGET
from rpojax.training.synthetic_data.scenery.backdrops import (
    BACKDROP_KINDS,
    add_reflections,
    add_structure,
    paint_backdrop,
)
from rpojax.training.synthetic_data.scenery.earth_views import EarthTextures
from rpojax.training.synthetic_data.spacecraft_sprites import Sprite
from rpojax.training.synthetic_data.visible_box import box_of_visible, known_edges, visible_coverage
from rpojax.vision.intersection_over_union import intersection_area, pairwise_iou

Rng = np.random.Generator
Layer = tuple[np.ndarray, np.ndarray]
"""Colour (p, p, 3), premultiplied and linear, and covered fraction (p, p)."""

_CUT_FRACTION = 0.1
_GAP_RANGE = (-0.5, 0.5)
"""Gap of two near spacecraft by the size of the smaller one; below 0 their boxes overlap."""
SIZE_PX = 128
_TARGET_FRACTION = 0.25
_MAX_PAIR_IOU = 0.5
_MIN_SHOWN_FRACTION = 0.35
"""Least part of a spacecraft that another one leaves free."""


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


@dataclasses.dataclass(frozen=True)
class CompositeMix:
    """What composites show how often.

    Attributes:
        backdrops: probability of each kind of backdrop
        target_backdrops: the same for images of the packaged target
        empty: fraction of images without a spacecraft
        apart: fraction of the others with two spacecraft whose boxes do not overlap
        near: fraction of the others with two that are near each other, touch or overlap
        foreground: fraction with structure at the frame's edge, and with reflections in a window
        shaded_clouds: whether clouds have a sunlit side
    """

    backdrops: Mapping[str, float]
    target_backdrops: Mapping[str, float]
    empty: float
    apart: float
    near: float
    foreground: float
    shaded_clouds: bool


GENERATORS: Mapping[int, CompositeMix] = {
    1: CompositeMix(
        backdrops={
            "black": 0.2,
            "stars": 0.12,
            "earth": 0.22,
            "limb": 0.21,
            "night": 0.1,
            "glint": 0.1,
            "moon": 0.05,
        },
        target_backdrops={
            "black": 0.55,
            "stars": 0.15,
            "earth": 0.1,
            "limb": 0.08,
            "night": 0.05,
            "glint": 0.04,
            "moon": 0.03,
        },
        empty=0.2,
        apart=0.06,
        near=0.0,
        foreground=0.0,
        shaded_clouds=False,
    ),
    2: CompositeMix(
        backdrops={
            "black": 0.14,
            "stars": 0.08,
            "earth": 0.23,
            "limb": 0.15,
            "night": 0.07,
            "glint": 0.11,
            "moon": 0.04,
            "city": 0.05,
            "flight": 0.13,
        },
        target_backdrops={
            "black": 0.35,
            "stars": 0.1,
            "earth": 0.11,
            "limb": 0.06,
            "night": 0.04,
            "glint": 0.04,
            "moon": 0.02,
            "city": 0.03,
            "flight": 0.25,
        },
        empty=0.16,
        apart=0.04,
        near=0.2,
        foreground=0.06,
        shaded_clouds=True,
    ),
}
"""Mixes by number; 1 is that of the first packaged detector, kept so that its figures can be compared."""


@dataclasses.dataclass(frozen=True)
class Composite:
    """An image with spacecraft.

    Attributes:
        image: (p, p, 3) 8 bit sRGB codes
        boxes: (n, 4) left, top, right, bottom [px]
        background: kind of backdrop
        craft: name of the spacecraft of each box
        mask: (p, p) fraction 0..255 of each pixel that visible spacecraft cover
        known: (n, 4) whether the image shows each edge
    """

    image: np.ndarray
    boxes: np.ndarray
    background: str
    craft: tuple[str, ...]
    mask: np.ndarray
    known: np.ndarray


def random_composite(
    rng: Rng,
    sprites: list[Sprite],
    earth: EarthTextures,
    size_px: int = SIZE_PX,
    mix: CompositeMix = GENERATORS[1],
) -> Composite:
    """Image with none, one or two spacecraft, exposed by a random sensor."""
    earth = dataclasses.replace(earth, shaded_clouds=mix.shaded_clouds)
    targets = [sprite for sprite in sprites if sprite.craft == PACKAGED_TARGET]
    others = [sprite for sprite in sprites if sprite.craft != PACKAGED_TARGET]
    of_target = bool(targets) and (not others or rng.random() < _TARGET_FRACTION)
    shares = mix.target_backdrops if of_target else mix.backdrops
    kind = str(rng.choice(BACKDROP_KINDS, p=[shares.get(name, 0.0) for name in BACKDROP_KINDS]))
    number, near = _random_number(rng, mix)
    background = paint_backdrop(rng, kind, earth, size_px) * np.float32(np.exp(rng.uniform(np.log(0.4), np.log(1.6))))
    sensor = ImageSensor(float(np.exp(rng.uniform(np.log(4e3), np.log(5e4)))), float(rng.uniform(2.0, 20.0)))
    if mix.foreground and rng.random() < mix.foreground:
        background = add_structure(rng, background).astype(np.float32)
    scene = _Scene(background, np.zeros((0, 4)), np.zeros((size_px, size_px)), np.zeros((0, 4), bool))
    chosen: list[Sprite] = []
    candidates = targets if of_target else others
    for _ in range(30):
        drawn = [candidates[int(rng.integers(len(candidates)))] for _ in range(number)]
        layers = (
            near_layers(rng, drawn, size_px, kind, of_target)
            if near
            else [random_layer(rng, sprite, size_px, kind, of_target) for sprite in drawn]
        )
        merged = _merge_layers(background, layers, sensor)
        if len(merged.boxes) == number and not (_is_crowded(layers, merged) if near else _any_overlap(merged.boxes)):
            scene, chosen = merged, drawn
            break
    image = add_artefacts(rng, scene.image)
    if mix.foreground and rng.random() < mix.foreground:
        image = add_reflections(rng, image).astype(np.float32)
    mask = np.round(255.0 * scene.coverage).astype(np.uint8)
    codes = expose_image(rng, image, sensor)
    return Composite(codes, scene.boxes, kind, tuple(sprite.craft for sprite in chosen), mask, scene.known)


def _random_number(rng: Rng, mix: CompositeMix) -> tuple[int, bool]:
    """Number of spacecraft, and whether two are near each other."""
    if rng.random() < mix.empty:
        return 0, False
    draw = rng.random()
    return (2, draw >= mix.apart) if draw < mix.apart + mix.near else (1, False)


@dataclasses.dataclass(frozen=True)
class _Scene:
    """Linear image (p, p, 3), boxes (n, 4), visible covered fraction (p, p), and which edges (n, 4) are known."""

    image: np.ndarray
    boxes: np.ndarray
    coverage: np.ndarray
    known: np.ndarray


def _merge_layers(background: np.ndarray, layers: list[Layer], sensor: ImageSensor) -> _Scene:
    """The background with all layers, later ones in front, and the boxes of the visible layers."""
    image, alphas = _blend(background, layers)
    boxes, known, coverage = [], [], np.zeros(background.shape[:2])
    for index, alpha in enumerate(alphas):
        visible = visible_coverage(image, background, alpha, sensor)
        box = box_of_visible(visible, alpha)
        if box is None:
            continue
        hidden, _ = _blend(background, layers[:index] + layers[index + 1 :])
        boxes.append(box)
        known.append(known_edges(image, hidden, alpha, box, sensor))
        coverage = coverage + visible
    return _Scene(
        image, np.array(boxes).reshape(-1, 4), np.clip(coverage, 0.0, 1.0), np.array(known, bool).reshape(-1, 4)
    )


def _blend(background: np.ndarray, layers: list[Layer]) -> tuple[np.ndarray, list[np.ndarray]]:
    """The background with all layers, and the fraction (p, p) of each that is not behind later ones."""
    image, alphas = background, []
    for color, alpha in layers:
        image = color + image * (1.0 - alpha[..., None])
        alphas = [other * (1.0 - alpha) for other in alphas] + [alpha]
    return image, alphas


def _is_crowded(layers: list[Layer], scene: _Scene) -> bool:
    """Whether one of two spacecraft hides most of the other, or their boxes are nearly the same."""
    (_, rear), (_, front) = layers
    shown = float((rear * (1.0 - front)).sum()) / max(float(rear.sum()), 1e-6)
    return shown < _MIN_SHOWN_FRACTION or bool(pairwise_iou(scene.boxes[:1], scene.boxes[1:])[0, 0] > _MAX_PAIR_IOU)


def _any_overlap(boxes: np.ndarray) -> bool:
    """Whether any two boxes overlap."""
    return bool(np.triu(intersection_area(boxes[:, None], boxes[None]), 1).any())
