"""Random sky behind a target: stars, the Earth's ground, clouds and fine detail."""

from importlib import resources

import jax
import numpy as np
from jaxtyping import Array
from scipy.ndimage import zoom

from rpojax.core.pytree import pytree

STAR_COUNT = 1500
_DETAIL_PX = 256


@pytree
class Sky:
    """Stars and textures of the Earth.

    Attributes:
        star_N: (n, 3) directions of stars
        star_radiance: (n,) radiance that a star adds to the one pixel it falls on, 1 = white level
        earth: (y, x, 3) linear colour of the ground, north up, 180 deg west at the left
        cloud: (y, x) thickness of clouds; below 0 there are none
        detail: (d, d) periodic noise of unit variance, for detail finer than the pixels of the other two
    """

    star_N: Array
    star_radiance: Array
    earth: Array
    cloud: Array
    detail: Array


def random_sky(seed: int = 0, cloud_fraction: float = 0.45) -> Sky:
    """Random stars with the brightness counts of the real sky, and the Earth under random clouds.

    The ground is NASA's Blue Marble (public domain), at 512 x 256 pixels. There are 1.5 10^(m/2) stars below
    magnitude m.
    """
    import cv2  # which changes LD_LIBRARY_PATH: not before a picture is made

    packed = np.frombuffer((resources.files("rpojax.vision") / "assets" / "earth.jpg").read_bytes(), np.uint8)
    ground = (np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR))[..., ::-1] / 255.0) ** 2.2
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(STAR_COUNT, 3))
    magnitude = 6.0 + 2.0 * np.log10(rng.uniform(1e-4, 1.0, STAR_COUNT))
    return Sky(
        star_N=_single(direction / np.linalg.norm(direction, axis=1, keepdims=True)),
        star_radiance=_single(0.3 * 10.0 ** (-0.4 * magnitude)),
        earth=_single(ground),
        cloud=_single(_clouds(rng, ground.shape[:2], cloud_fraction)),
        detail=_single(_noise_tile(rng)),
    )


def _single(values: np.ndarray) -> Array:
    return jax.device_put(values.astype(np.float32))


def _clouds(rng: np.random.Generator, shape: tuple[int, ...], fraction: float) -> np.ndarray:
    """Thickness (y, x) of clouds, above 0 over a fraction of the map: octaves of noise, periodic in longitude."""
    total = np.zeros(shape)
    for octave in range(2, 7):
        cells = 2**octave
        noise = rng.normal(size=(cells // 2 + 1, cells))
        noise = np.concatenate([noise, noise[:, :1]], axis=1)
        factors = (shape[0] / noise.shape[0], shape[1] / noise.shape[1])
        total = total + np.asarray(zoom(noise, factors, order=1))[: shape[0], : shape[1]] * 0.6**octave
    return (total - np.quantile(total, 1.0 - fraction)) / total.std()


def _noise_tile(rng: np.random.Generator) -> np.ndarray:
    """Periodic noise of unit variance whose amplitude falls with frequency to the power 1.4."""
    rows, columns = np.fft.fftfreq(_DETAIL_PX)[:, None], np.fft.fftfreq(_DETAIL_PX)[None, :]
    frequency = np.hypot(rows, columns)
    frequency[0, 0] = np.inf
    spectrum = np.fft.fft2(rng.normal(size=(_DETAIL_PX, _DETAIL_PX))) * frequency**-1.4
    noise = np.fft.ifft2(spectrum).real
    return noise / noise.std()
