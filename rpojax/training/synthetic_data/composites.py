"""Random composites of sprites and backdrops, with the boxes of the spacecraft in them."""

import dataclasses

import numpy as np

from rpojax.training.synthetic_data.backdrops import BACKDROP_KINDS, paint_backdrop
from rpojax.training.synthetic_data.earth_textures import EarthTextures
from rpojax.training.synthetic_data.image_sensor import ImageSensor, expose_image
from rpojax.training.synthetic_data.meshes.packaged_target import PACKAGED_TARGET
from rpojax.training.synthetic_data.spacecraft_sprites import Sprite
from rpojax.training.synthetic_data.visible_box import visible_box
from rpojax.vision.intersection_over_union import intersection_area

Rng = np.random.Generator

SIZE_PX = 128
EMPTY_FRACTION = 0.2
_TWO_CRAFT_FRACTION = 0.06
_TARGET_FRACTION = 0.25
_CUT_FRACTION = 0.1
_BACKDROP_PROBABILITIES = {
    "black": 0.2,
    "stars": 0.12,
    "earth": 0.22,
    "limb": 0.21,
    "night": 0.1,
    "glint": 0.1,
    "moon": 0.05,
}
_TARGET_BACKDROP_PROBABILITIES = {
    "black": 0.55,
    "stars": 0.15,
    "earth": 0.1,
    "limb": 0.08,
    "night": 0.05,
    "glint": 0.04,
    "moon": 0.03,
}


@dataclasses.dataclass(frozen=True)
class Composite:
    """Image (p, p, 3) of 8 bit sRGB codes, boxes (n, 4) left, top, right, bottom [px], backdrop and spacecraft."""

    image: np.ndarray
    boxes: np.ndarray
    background: str
    craft: tuple[str, ...]


def random_composite(rng: Rng, sprites: list[Sprite], earth: EarthTextures, size_px: int = SIZE_PX) -> Composite:
    """Image with none, one or two spacecraft, exposed by a random sensor."""
    targets = [sprite for sprite in sprites if sprite.craft == PACKAGED_TARGET]
    others = [sprite for sprite in sprites if sprite.craft != PACKAGED_TARGET]
    of_target = bool(targets) and (not others or rng.random() < _TARGET_FRACTION)
    shares = _TARGET_BACKDROP_PROBABILITIES if of_target else _BACKDROP_PROBABILITIES
    kind = str(rng.choice(BACKDROP_KINDS, p=[shares[name] for name in BACKDROP_KINDS]))
    number = 0 if rng.random() < EMPTY_FRACTION else 2 if rng.random() < _TWO_CRAFT_FRACTION else 1
    background = paint_backdrop(rng, kind, earth, size_px) * np.float32(np.exp(rng.uniform(np.log(0.4), np.log(1.6))))
    sensor = ImageSensor(float(np.exp(rng.uniform(np.log(4e3), np.log(5e4)))), float(rng.uniform(2.0, 20.0)))
    for _ in range(30):
        chosen = [_random_sprite(rng, targets if of_target else others) for _ in range(number)]
        layers = [_random_layer(rng, sprite, size_px, kind, of_target) for sprite in chosen]
        image, boxes = _merge_layers(background, layers, sensor)
        if len(boxes) == number and not _any_overlap(boxes):
            break
    else:
        image, boxes, chosen = background, np.zeros((0, 4)), []
    image = _add_artefacts(rng, image)
    return Composite(expose_image(rng, image, sensor), boxes, kind, tuple(sprite.craft for sprite in chosen))


def _random_sprite(rng: Rng, sprites: list[Sprite]) -> Sprite:
    return sprites[int(rng.integers(len(sprites)))]


def _random_layer(rng: Rng, sprite: Sprite, size_px: int, kind: str, is_target: bool) -> tuple[np.ndarray, np.ndarray]:
    """Colour (p, p, 3) and alpha (p, p) of a sprite at a random size and place, under random light."""
    side = _random_side(rng, size_px, is_target)
    sun, shine = _random_light(rng, kind, is_target)
    tint = np.array([1.0, 1.0, 1.0]) if is_target else 1.0 + rng.normal(scale=0.08, size=3)
    color = (sun * sprite.sunlit + shine * sprite.earth_shine) * tint.astype(np.float32)
    pixels = np.concatenate([np.minimum(color, 4.0), sprite.alpha[..., None]], axis=2).astype(np.float32)
    scale = side / max(sprite.alpha.shape)
    height, width = (scale * n for n in sprite.alpha.shape)
    slack_x, slack_y = size_px - width, size_px - height
    corner = [rng.uniform(min(0.0, s), max(0.0, s)) for s in (slack_x, slack_y)]
    if rng.random() < _CUT_FRACTION:
        corner = [rng.uniform(-0.5 * extent, size_px - 0.5 * extent) for extent in (width, height)]
    resampled = _resample(pixels, scale, corner, size_px)
    return resampled[..., :3], np.clip(resampled[..., 3], 0.0, 1.0)


def _random_side(rng: Rng, size_px: int, is_target: bool) -> float:
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
    import cv2

    fine = 2
    # Area averaging to nearly the final size first, against aliasing in the exact resampling that follows.
    rough = [max(1, int(np.ceil(n * min(1.0, scale * fine)))) for n in pixels.shape[:2]]
    small = cv2.resize(pixels, rough[::-1], interpolation=cv2.INTER_AREA)
    ratio = [fine * scale * n / r for n, r in zip(pixels.shape[:2], rough, strict=True)]
    shift = [fine * c + 0.5 * r - 0.5 for c, r in zip(corner, ratio[::-1], strict=True)]
    matrix = np.array([[ratio[1], 0.0, shift[0]], [0.0, ratio[0], shift[1]]])
    canvas = cv2.warpAffine(np.asarray(small), matrix, (fine * size_px, fine * size_px), flags=cv2.INTER_LINEAR)
    return np.asarray(cv2.resize(canvas, (size_px, size_px), interpolation=cv2.INTER_AREA))


def _merge_layers(
    background: np.ndarray, layers: list[tuple[np.ndarray, np.ndarray]], sensor: ImageSensor
) -> tuple[np.ndarray, np.ndarray]:
    """The background with all layers, later ones in front, and the boxes of those that are visible."""
    image, alphas = background, []
    for color, alpha in layers:
        image = color + image * (1.0 - alpha[..., None])
        alphas = [other * (1.0 - alpha) for other in alphas] + [alpha]
    boxes = [box for alpha in alphas if (box := visible_box(image, background, alpha, sensor)) is not None]
    return image, np.array(boxes).reshape(-1, 4)


def _any_overlap(boxes: np.ndarray) -> bool:
    """Whether any two boxes overlap."""
    return bool(np.triu(intersection_area(boxes[:, None], boxes[None]), 1).any())


def _add_artefacts(rng: Rng, image: np.ndarray) -> np.ndarray:
    """The image with random camera artefacts: hot pixels, particle tracks, ghosts of the Sun."""
    import cv2

    size = image.shape[0]
    image = np.ascontiguousarray(image, np.float32)
    if rng.random() < 0.12:
        for _ in range(int(rng.integers(1, 8))):
            row, column = rng.integers(0, size, 2)
            image[row, column] += np.float32(rng.uniform(0.05, 1.0)) * rng.uniform(0.2, 1.0, 3).astype(np.float32)
    if rng.random() < 0.06:
        start = rng.integers(0, size, 2)
        end = start + rng.integers(-12, 13, 2)
        track = np.zeros((size, size), np.float32)
        cv2.line(track, tuple(map(int, start)), tuple(map(int, end)), float(rng.uniform(0.1, 1.0)), 1, cv2.LINE_AA)
        image = image + track[..., None]
    if rng.random() < 0.08:
        y, x = np.mgrid[:size, :size].astype(np.float32)
        for _ in range(int(rng.integers(1, 4))):
            center, radius = rng.uniform(0.0, size, 2), rng.uniform(3.0, 40.0)
            disc = 1.0 / (1.0 + np.exp((np.hypot(x - center[0], y - center[1]) - radius) / rng.uniform(0.5, 6.0)))
            image = image + np.float32(rng.uniform(0.005, 0.15)) * disc[..., None] * rng.uniform(0.3, 1.0, 3)
    return image.astype(np.float32)
