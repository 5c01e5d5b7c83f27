"""What is behind the target: stars, and the Earth's disc with clouds and a limb, placed by the camera's attitude."""

from importlib import resources

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.vision.pinhole import Intrinsics

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Image = Float[Array, "h w 3"]

STAR_COUNT = 1500
_SCALE_HEIGHT = 0.003
_AIR_COLOR = (0.25, 0.45, 0.9)
_HAZE = 0.06
_DETAIL_PX = 256
_DETAILS = ((36.0, 0.9), (288.0, 0.5))
"""How often the tile of detail goes round the equator, and how strongly it counts: 1100 and 140 km a tile."""


@pytree
class Sky:
    """The surroundings of an orbit.

    Attributes:
        star_N: (n, 3) directions of stars
        star_light: (n,) what a star adds to the one pixel it falls on, 1 = white level
        earth: (y, x, 3) linear colour of the ground, north up, 180 deg west at the left
        cloud: (y, x) how thick clouds are, some of it below 0
        detail: (d, d) noise of unit variance that repeats, for what is smaller than the pixels of the two
    """

    star_N: Array
    star_radiance: Array
    earth: Array
    cloud: Array
    detail: Array


def random_sky(seed: int = 0, cloud_fraction: float = 0.45) -> Sky:
    """Random stars, as much more frequent the fainter as in the real sky, and an Earth under random clouds.

    The ground is NASA's Blue Marble (public domain), at 512 x 256 pixels. There are
    1.5 10^(m/2) stars below magnitude m.
    """
    import cv2

    packed = np.frombuffer((resources.files("rpojax.vision") / "assets" / "earth.jpg").read_bytes(), np.uint8)
    ground = (np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR))[..., ::-1] / 255.0) ** 2.2
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(STAR_COUNT, 3))
    magnitude = 6.0 + 2.0 * np.log10(rng.uniform(1e-4, 1.0, STAR_COUNT))
    return Sky(
        star_N=jnp.asarray(direction / np.linalg.norm(direction, axis=1, keepdims=True), jnp.float32),
        star_radiance=jnp.asarray(0.3 * 10.0 ** (-0.4 * magnitude), jnp.float32),
        earth=jnp.asarray(ground, jnp.float32),
        cloud=jnp.asarray(_clouds(rng, ground.shape[:2], cloud_fraction), jnp.float32),
        detail=jnp.asarray(_noise_tile(rng), jnp.float32),
    )


def _clouds(rng: np.random.Generator, shape: tuple[int, ...], fraction: float) -> np.ndarray:
    """Thickness (y, x) of clouds, above 0 over a share: noise summed over octaves, that closes round the globe."""
    from scipy.ndimage import zoom  # a third of a second that only pictures need

    total = np.zeros(shape)
    for octave in range(2, 7):
        cells = 2**octave
        noise = rng.normal(size=(cells // 2 + 1, cells))
        noise = np.concatenate([noise, noise[:, :1]], axis=1)
        factors = (shape[0] / noise.shape[0], shape[1] / noise.shape[1])
        total = total + np.asarray(zoom(noise, factors, order=1))[: shape[0], : shape[1]] * 0.6**octave
    return (total - np.quantile(total, 1.0 - fraction)) / total.std()


def _noise_tile(rng: np.random.Generator) -> np.ndarray:
    """Noise of unit variance whose amplitude falls with frequency to the power 1.4, and that repeats at its edges."""
    rows, columns = np.fft.fftfreq(_DETAIL_PX)[:, None], np.fft.fftfreq(_DETAIL_PX)[None, :]
    frequency = np.hypot(rows, columns)
    frequency[0, 0] = np.inf
    spectrum = np.fft.fft2(rng.normal(size=(_DETAIL_PX, _DETAIL_PX))) * frequency**-1.4
    noise = np.fft.ifft2(spectrum).real
    return noise / noise.std()


def background(
    sky: Sky,
    intrinsics: Intrinsics,
    width_px: int,
    height_px: int,
    R_KN: Matrix,
    position: Vector,
    sun_N: Vector,
    earth_rotation: Array,
    binning: Array | float = 1.0,
) -> Image:
    """Linear picture (h, w, 3) of stars and Earth; all arrays float32.

    `position` is the camera from the Earth's centre in Earth radii and N components, `sun_N` a unit vector, `turn` the
    angle [rad] by which the Earth has turned about its pole, Greenwich from N's x axis. A star's light is spread over
    `binning` squared of the detector's pixels, of which one of the picture's is the mean.
    """
    center, focal = intrinsics.center_px.astype(jnp.float32), intrinsics.focal_px.astype(jnp.float32)
    x = (jnp.arange(width_px, dtype=jnp.float32) + 0.5 - center[0]) / focal
    y = (jnp.arange(height_px, dtype=jnp.float32) + 0.5 - center[1]) / focal
    shape = (height_px, width_px)
    rays_K = jnp.stack(
        [jnp.broadcast_to(x[None, :], shape), jnp.broadcast_to(y[:, None], shape), jnp.ones(shape, jnp.float32)]
    )
    rays_K = rays_K * jax.lax.rsqrt(jnp.sum(rays_K * rays_K, axis=0))[None]
    rays_N = jnp.einsum("ki,khw->ihw", R_KN, rays_K)
    ground, cover = _earth(sky, rays_N, position, sun_N, earth_rotation)
    stars = _stars(sky, center, focal, shape, R_KN)
    return ground + (stars / (binning * binning))[:, :, None] * (1.0 - cover)[:, :, None]


def _earth(sky: Sky, rays_N: Array, position: Array, sun_N: Array, earth_rotation: Array) -> tuple[Array, Array]:
    """Light of the ground and of the air above the limb, and whether the ground is there."""
    along = jnp.sum(rays_N * position[:, None, None], axis=0)
    square = jnp.sum(position * position)
    nearest = jnp.maximum(square - along * along, 0.0)
    hit = (nearest < 1.0) & (along < 0.0)
    distance = -along - jnp.sqrt(jnp.where(hit, 1.0 - nearest, 0.0))
    point = position[:, None, None] + distance[None] * rays_N
    lit = jnp.maximum(jnp.sum(point * sun_N[:, None, None], axis=0), 0.0)
    haze = _HAZE * jnp.asarray(_AIR_COLOR, jnp.float32)[None, None, :]
    ground = jnp.where(hit[:, :, None], (_surface(sky, point, hit, earth_rotation) + haze) * lit[:, :, None], 0.0)
    # Above the limb: light of the air at the height where the ray passes, as bright as the ground below would be.
    height = jnp.sqrt(nearest) - 1.0
    foot = position[:, None, None] - along[None] * rays_N
    above = jnp.maximum(jnp.sum(foot * sun_N[:, None, None], axis=0), 0.0)
    glow = jnp.where((along < 0.0) & ~hit, above * jnp.exp(-jnp.maximum(height, 0.0) / _SCALE_HEIGHT), 0.0)
    air = 0.5 * glow[:, :, None] * jnp.asarray(_AIR_COLOR, jnp.float32)[None, None, :]
    return ground + air, hit.astype(jnp.float32)


def _surface(sky: Sky, point: Array, hit: Array, earth_rotation: Array) -> Array:
    """Linear colour (h, w, 3) of ground and clouds under full light at points (3, h, w) of the unit sphere."""
    south = 0.5 - jnp.arcsin(jnp.clip(point[2], -1.0, 1.0)) / jnp.pi
    east = (jnp.arctan2(point[1], jnp.where(hit, point[0], 1.0)) - earth_rotation) / (2.0 * jnp.pi) + 0.5
    small = jnp.zeros_like(south)
    for times, strength in _DETAILS:
        # Meridians come together at the poles, and with them the pattern; no camera looks there for long.
        small = small + strength * _bilinear(sky.detail, 0.5 * south * times, east * times)
    # Half a texel from the poles the textures end; their rows do not go round.
    middle = jnp.clip(south, 0.5 / sky.cloud.shape[0], 1.0 - 0.5 / sky.cloud.shape[0])
    thickness = _bilinear(sky.cloud, middle, east) + 0.6 * small
    cover = jnp.clip(thickness, 0.0, 1.0)[:, :, None]
    ground = _bilinear(sky.earth, middle, east) * (1.0 + 0.15 * small)[:, :, None]
    return jnp.maximum(ground, 0.0) * (1.0 - cover) + (0.75 + 0.05 * small)[:, :, None] * cover


def _bilinear(texture: Array, down: Array, across: Array) -> Array:
    """Values of a texture (y, x, ...) at places (h, w), in shares of its height and width; it repeats."""
    rows, columns = texture.shape[:2]
    y, x = down * rows - 0.5, across * columns - 0.5
    first_y, first_x = jnp.floor(y), jnp.floor(x)
    share_y, share_x = y - first_y, x - first_x
    total = jnp.zeros((), jnp.float32)
    for step_y in (0, 1):
        for step_x in (0, 1):
            weight = (share_y if step_y else 1.0 - share_y) * (share_x if step_x else 1.0 - share_x)
            row = jnp.mod(first_y.astype(jnp.int32) + step_y, rows)
            column = jnp.mod(first_x.astype(jnp.int32) + step_x, columns)
            total = total + weight.reshape(weight.shape + (1,) * (texture.ndim - 2)) * texture[row, column]
    return total


def _stars(sky: Sky, center: Array, focal: Array, shape: tuple[int, int], R_KN: Array) -> Array:
    """Light of stars, each shared by the four pixels around it."""
    seen = jnp.einsum("ki,ni->nk", R_KN, sky.star_N)
    ahead = seen[:, 2] > 0.1
    depth = jnp.where(ahead, seen[:, 2], 1.0)
    place = center[None, :] + focal * seen[:, :2] / depth[:, None] - 0.5
    first = jnp.floor(place)
    share = place - first
    column, row = first[:, 0].astype(jnp.int32), first[:, 1].astype(jnp.int32)
    light = jnp.where(ahead, sky.star_radiance, 0.0)
    picture = jnp.zeros(shape, jnp.float32)
    for dy in (0, 1):
        for dx in (0, 1):
            part = (share[:, 0] if dx else 1.0 - share[:, 0]) * (share[:, 1] if dy else 1.0 - share[:, 1])
            inside = (column + dx >= 0) & (column + dx < shape[1]) & (row + dy >= 0) & (row + dy < shape[0])
            rows, columns = jnp.where(inside, row + dy, 0), jnp.where(inside, column + dx, 0)
            picture = picture.at[rows, columns].add(jnp.where(inside, light * part, 0.0))
    return picture
