"""Random backdrops of synthetic images: space, stars, Moon, and the Earth by day, at night, at its limb, with glint."""

import dataclasses
import functools
from collections.abc import Callable

import cv2
import jax
import jax.numpy as jnp
import numpy as np

from rpojax.training.synthetic_data.scenery.earth_views import (
    EarthTextures,
    EarthView,
    atmosphere,
    daylight,
    ground_image,
    noise_patch,
    random_earth_view,
    unit,
    unit_rows,
)
from rpojax.vision.imaging.random_sky import Sky, random_sky
from rpojax.vision.imaging.sky_background import background
from rpojax.vision.pinhole import Intrinsics

Rng = np.random.Generator

_SKIES = 12
"""Different skies, each with its own stars and clouds."""
_LIMB_SHARE = 0.4
_FIRST_SEED = 1000
"""Of the skies; scenarios have small seeds."""
BACKDROP_KINDS = ("black", "stars", "earth", "limb", "night", "glint", "moon", "city", "flight")


def paint_flight_backdrop(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """Linear image (p, p, 3) of the Earth or its limb by `vision.imaging.sky_background`, by day or in twilight."""
    limb = bool(rng.random() < _LIMB_SHARE)
    view = random_earth_view(rng, earth, size_px, limb, sun_height=(-0.2, 1.0))
    return np.asarray(_render(_sky(int(rng.integers(_SKIES))), *_camera(view, size_px), size_px=size_px))


@functools.lru_cache(maxsize=_SKIES)
def _sky(index: int) -> Sky:
    """A sky whose clouds cover between a tenth and nine tenths of it."""
    return random_sky(_FIRST_SEED + index, 0.1 + 0.8 * index / (_SKIES - 1))


def _camera(view: EarthView, size_px: int) -> tuple[Intrinsics, jax.Array, jax.Array, jax.Array]:
    """Intrinsics, R_KN, position and direction to the Sun of a view, with Earth axes as N."""
    center = jnp.full(2, 0.5 * size_px, jnp.float32)
    intrinsics = Intrinsics(focal_px=jnp.asarray(view.focal_px, jnp.float32), center_px=center)
    axes, position, sun = (jnp.asarray(values, jnp.float32) for values in (view.axes, view.position, view.sun))
    return intrinsics, axes, position, sun


@functools.partial(jax.jit, static_argnames="size_px")
def _render(
    sky: Sky, intrinsics: Intrinsics, R_KN: jax.Array, position: jax.Array, sun: jax.Array, size_px: int
) -> jax.Array:
    return background(sky, intrinsics, size_px, size_px, R_KN, position, sun, jnp.zeros((), jnp.float32))


def paint_backdrop(rng: Rng, kind: str, earth: EarthTextures, size_px: int) -> np.ndarray:
    """Linear image (p, p, 3) float32 of one of `BACKDROP_KINDS`, 1 = white level at unit exposure."""
    return _BACKDROPS[kind](rng, earth, size_px).astype(np.float32)


def _black(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    return np.zeros((size_px, size_px, 3))


def _stars(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """Stars of all brightnesses, sometimes trailed, with or without a faint glow."""
    image = np.zeros((size_px, size_px, 3), np.float32)
    count = int(rng.integers(1, 120))
    place = rng.integers(0, size_px, (count, 2))
    light = np.minimum(0.004 * rng.uniform(1e-4, 1.0, count) ** -0.8, 3.0) * rng.uniform(0.3, 2.0)
    image[place[:, 1], place[:, 0]] = light[:, None] * rng.uniform(0.7, 1.3, (count, 3))
    if rng.random() < 0.2:
        angle, half_length = rng.uniform(0.0, np.pi), int(rng.integers(3, 12))
        kernel = np.zeros((2 * half_length + 1, 2 * half_length + 1), np.float32)
        offset = np.array([np.cos(angle), np.sin(angle)]) * half_length
        first, last = (tuple(round(half_length + s * float(v)) for v in offset) for s in (-1.0, 1.0))
        cv2.line(kernel, first, last, 1.0)
        image = np.asarray(cv2.filter2D(image, -1, kernel / kernel.max() * 0.5))
    if rng.random() < 0.3:
        image = image + 0.02 * rng.random() * np.clip(1.0 + noise_patch(rng, earth, size_px), 0.0, 3.0)[..., None]
    return image


def _moon(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """The Moon with a phase and a random texture, whole or cut by the frame, in front of stars."""
    radius = float(np.exp(rng.uniform(np.log(2.5), np.log(0.6 * size_px))))
    center = rng.uniform(-0.1, 1.1, 2) * size_px
    y, x = np.mgrid[:size_px, :size_px] + 0.5
    u, v = (x - center[0]) / radius, (y - center[1]) / radius
    square = u * u + v * v
    height = np.sqrt(np.clip(1.0 - square, 0.0, 1.0))
    sun = rng.normal(size=3) + np.array([0.0, 0.0, 0.7])
    sun /= np.linalg.norm(sun)
    lit = np.clip(u * sun[0] + v * sun[1] + height * sun[2], 0.0, 1.0) ** 0.6
    edge = np.clip((1.0 - np.sqrt(square)) * radius + 0.5, 0.0, 1.0)
    texture = np.clip(1.0 + 0.35 * noise_patch(rng, earth, size_px), 0.3, 1.7)
    disc = rng.uniform(0.1, 0.9) * (lit * edge * texture)[..., None] * np.array([1.0, 0.97, 0.92])
    return disc + _stars(rng, earth, size_px) * (1.0 - edge[..., None])


def _earth(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """The sunlit Earth from above."""
    view = random_earth_view(rng, earth, size_px, limb=False, sun_height=(0.15, 1.0))
    ground = ground_image(rng, earth, view, float(rng.beta(1.0, 1.3)))
    return daylight(ground, view) + atmosphere(rng, ground, view)


def _limb(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """The Earth's limb, sunlit or in twilight."""
    if rng.random() < 0.35:
        return _twilight(rng, earth, size_px)
    view = random_earth_view(rng, earth, size_px, limb=True, sun_height=(0.0, 1.0))
    ground = ground_image(rng, earth, view, float(rng.beta(1.0, 1.3)))
    space = ~ground.hit[..., None] * (_stars(rng, earth, size_px) if rng.random() < 0.2 else 0.0)
    return daylight(ground, view) + atmosphere(rng, ground, view) + space


def _twilight(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """The limb with the Sun behind it: dark ground, bands from red over white to blue, black."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    y, x = (np.mgrid[:size_px, :size_px] + 0.5) / size_px - 0.5
    curve = rng.uniform(0.0, 0.3)
    across, along = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    height = across + curve * along**2 + rng.uniform(-0.3, 0.3)
    height = height / float(np.exp(rng.uniform(np.log(0.03), np.log(0.6))))
    height = height + 0.03 * noise_patch(rng, earth, size_px) * np.exp(-4.0 * np.abs(height))
    stops = np.array([-0.03, 0.0, 0.12, 0.3, 0.55, 0.8, 1.2])
    red, white, blue = rng.uniform(0.2, 0.9), rng.uniform(0.3, 1.6), rng.uniform(0.1, 0.7)
    colors = np.array(
        [
            [0.0, 0.0, 0.0],
            [0.25 * red, 0.04 * red, 0.01],
            [red, 0.35 * red, 0.06 * red],
            [white, 0.9 * white, 0.8 * white],
            [0.3 * blue, 0.65 * blue, blue],
            [0.05 * blue, 0.2 * blue, 0.5 * blue],
            [0.0, 0.0, 0.0],
        ]
    ) * np.clip(1.0 + 0.15 * rng.normal(size=(7, 1)), 0.4, 1.6)
    bands = np.stack([np.interp(height, stops, colors[:, c]) for c in range(3)], axis=2)
    fade = np.exp(-((along - rng.uniform(-0.5, 0.5)) ** 2) / rng.uniform(0.05, 2.0))
    return bands * fade[..., None]


def _night(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """The night side: with or without cities, faint clouds, and airglow at the limb."""
    limb = bool(rng.random() < 0.5)
    view = random_earth_view(rng, earth, size_px, limb, sun_height=(-1.0, -0.1))
    ground = ground_image(rng, earth, view, float(rng.beta(1.0, 1.3)))
    moonlight = float(np.exp(rng.uniform(np.log(1e-4), np.log(0.02))))
    color = ground.color * (1.0 - ground.clouds[..., None]) + 0.85 * ground.clouds[..., None]
    image = moonlight * color * ground.hit[..., None]
    if rng.random() < 0.7:
        crowd = np.clip(noise_patch(rng, earth, size_px) + rng.uniform(-1.5, 0.3), 0.0, None)
        sparks = rng.random((size_px, size_px)) ** float(rng.uniform(8.0, 40.0))
        lights = crowd * sparks * (1.0 - ground.sea) * (1.0 - 0.9 * ground.clouds) * ground.hit
        image = image + rng.uniform(0.05, 1.5) * lights[..., None] * np.array([1.0, rng.uniform(0.6, 0.9), 0.4])
    glow = ~ground.hit * np.exp(-(((ground.height - 0.014) / rng.uniform(0.001, 0.006)) ** 2))
    tint = np.array([rng.uniform(0.1, 1.0), 1.0, rng.uniform(0.1, 0.6)])
    image = image + rng.uniform(0.0, 0.05) * glow[..., None] * tint
    space = ~ground.hit[..., None] * (_stars(rng, earth, size_px) if rng.random() < 0.6 else 0.0)
    return image + space


def _city(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """City lights near by: clusters of lamps and the roads between them, over dark ground under faint clouds."""
    view = random_earth_view(rng, earth, size_px, limb=bool(rng.random() < 0.3), sun_height=(-1.0, -0.2))
    ground = ground_image(rng, earth, view, float(rng.beta(1.0, 2.0)))
    centers = rng.uniform(-0.2, 1.2, (int(rng.integers(1, 8)), 2)) * size_px
    places = [_cluster(rng, center, size_px) for center in centers]
    places += [_road(rng, *rng.permutation(centers)[:2]) for _ in range(int(rng.integers(0, 6))) if len(centers) > 1]
    lamps = np.concatenate(places)
    pixel = np.floor(lamps).astype(int)
    pixel = pixel[((pixel >= 0) & (pixel < size_px)).all(axis=1)]
    lights = np.zeros((size_px, size_px), np.float32)
    np.add.at(lights, (pixel[:, 1], pixel[:, 0]), np.exp(rng.normal(scale=1.0, size=len(pixel))).astype(np.float32))
    sharp = cv2.GaussianBlur(lights, (0, 0), float(rng.uniform(0.3, 1.2)))
    glow = cv2.GaussianBlur(lights, (0, 0), float(rng.uniform(2.0, 6.0)))
    brightness = float(np.exp(rng.uniform(np.log(0.03), np.log(0.8))))
    color = np.array([1.0, rng.uniform(0.55, 0.95), rng.uniform(0.25, 0.8)])
    seen = ((sharp + rng.uniform(0.0, 0.6) * glow) * (1.0 - 0.8 * ground.clouds) * ground.hit)[..., None]
    moonlight = float(np.exp(rng.uniform(np.log(1e-4), np.log(0.01))))
    dark = moonlight * (ground.color + ground.clouds[..., None]) * ground.hit[..., None]
    return dark + brightness * seen * color


def _cluster(rng: Rng, center: np.ndarray, size_px: int) -> np.ndarray:
    """Places (n, 2) [px] of the lamps of a city, dense at its centre, many on a grid of streets."""
    count = int(np.exp(rng.uniform(np.log(15.0), np.log(600.0))))
    reach = float(rng.uniform(0.02, 0.15)) * size_px
    places = rng.normal(size=(count, 2)) * rng.exponential(reach, (count, 1))
    if rng.random() < 0.5:
        spacing = float(rng.uniform(2.0, 6.0))
        along = rng.integers(0, 2, count)
        rows = np.arange(count)
        places[rows, along] = np.round(places[rows, along] / spacing) * spacing
    angle = rng.uniform(0.0, np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return center + places @ turn.T


def _road(rng: Rng, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Places (n, 2) [px] of lamps on a bent road between two cities."""
    way = np.sort(rng.random(int(rng.integers(20, 150))))[:, None]
    across = (end - start)[::-1] * np.array([-1.0, 1.0])
    bend = rng.normal(scale=0.15) * np.sin(np.pi * way) + 0.01 * rng.normal(size=way.shape)
    return start + way * (end - start) + bend * across


def _glint(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """Sea with the specular reflection of the Sun."""
    view = random_earth_view(rng, earth, size_px, limb=bool(rng.random() < 0.3), sun_height=(0.05, 0.9))
    ground = ground_image(rng, earth, view, 0.6 * float(rng.beta(1.0, 2.0)))
    aim = int(rng.integers(size_px)), int(rng.integers(size_px))
    normal = unit_rows(ground.point)
    if ground.hit[aim]:
        # The Sun at the specular reflection of this pixel.
        ray, up = view.rays[aim], normal[aim]
        view = dataclasses.replace(view, sun=unit(ray - 2.0 * float(ray @ up) * up))
    sea = np.array([0.01, 0.03, 0.07])
    sea_fraction = np.clip(ground.sea + (1.0 if rng.random() < 0.5 else 0.0), 0.0, 1.0)[..., None]
    ground = dataclasses.replace(ground, color=ground.color * (1.0 - sea_fraction) + sea_fraction * sea)
    half = unit_rows(view.sun - view.rays)
    cosine = np.clip((half * normal).sum(axis=2), 0.0, 1.0)
    rough = float(np.exp(rng.uniform(np.log(0.02), np.log(0.25))))
    ripple = np.clip(1.0 + 0.4 * noise_patch(rng, earth, size_px), 0.2, 2.5)
    shine = np.exp(-((1.0 - cosine**2) / np.maximum(cosine**2, 1e-3)) / rough**2) * ripple
    shine = rng.uniform(0.3, 3.0) * shine * sea_fraction[..., 0] * (1.0 - ground.clouds) * ground.hit
    warm = np.array([1.0, rng.uniform(0.75, 1.0), rng.uniform(0.5, 1.0)])
    return daylight(ground, view) + shine[..., None] * warm + atmosphere(rng, ground, view)


_BACKDROPS: dict[str, Callable[[Rng, EarthTextures, int], np.ndarray]] = {
    "black": _black,
    "stars": _stars,
    "earth": _earth,
    "limb": _limb,
    "night": _night,
    "glint": _glint,
    "moon": _moon,
    "city": _city,
    "flight": paint_flight_backdrop,
}


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
