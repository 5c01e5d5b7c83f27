"""From a field to a camera's frame: rays in a square around the target, averaged to pixels; what the camera adds."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.vision.field import Field, Rays, bounding_ball, render_rays
from rpojax.vision.pinhole import Lens

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Scalar = Float[Array, ""]
Image = Float[Array, "h w 3"]

REGIONS_PX = (16, 32, 48, 64, 96, 128, 192, 256)
_MARGIN = 1.03


@pytree
class Frame:
    """A target in a frame.

    Attributes:
        color: (h, w, 3) linear radiance on black, 1 = white level
        alpha: (h, w) share of the pixel that the target covers
        depth: (h, w) distance [m] times that share
    """

    color: Array
    alpha: Array
    depth: Array


def encode(linear: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """sRGB code values of linear radiance, clipped to 0..1 (IEC 61966-2-1)."""
    clipped = jnp.clip(linear, 0.0, 1.0)
    root = 1.055 * jnp.maximum(clipped, 0.0031308) ** (1.0 / 2.4) - 0.055
    return jnp.where(clipped <= 0.0031308, 12.92 * clipped, root)


def pixel_directions(size_px: int, field_of_view_deg: float) -> np.ndarray:
    """Unit vectors (p, p, 3) in camera axes through the middles of a square frame's pixels."""
    place = (np.arange(size_px) + 0.5) / size_px * 2.0 - 1.0
    x, y = np.meshgrid(place, place)
    tangent = np.tan(np.radians(0.5 * field_of_view_deg))
    directions = np.stack([x * tangent, y * tangent, np.ones_like(x)], axis=2)
    return (directions / np.linalg.norm(directions, axis=2, keepdims=True)).astype(np.float32)


def region_size(focal_px: float, radius_m: float, least_range_m: float, oversampling: float = 1.5) -> int:
    """Side [samples] of the square of rays that a segment of a run needs, chosen on the host.

    The rays are `oversampling` times as dense as the pixels at the least range that the segment may come to.
    """
    if least_range_m <= radius_m:
        return REGIONS_PX[-1]
    width = 2.0 * focal_px * radius_m / np.sqrt(least_range_m**2 - radius_m**2)
    return next((size for size in REGIONS_PX if size >= oversampling * width), REGIONS_PX[-1])


def render_frame(
    field: Field,
    lens: Lens,
    width_px: int,
    height_px: int,
    region_px: int,
    r_KT_T: Vector,
    R_KT: Matrix,
    sun_T: Vector,
    sunlight: Scalar,
) -> Frame:
    """The target in a frame, from the camera's position [m] and axes, the direction of the Sun, all in T, and sunlight.

    `sunlight` is 0 in eclipse and 1 outside; arrays are float32, `region_px` is static. Differentiable in pose and Sun.
    """
    corner, side, visible = _region(field, lens, r_KT_T, R_KT)
    rays = _region_rays(field, lens, region_px, corner, side, r_KT_T, R_KT, sun_T)
    cells = jnp.concatenate([rays.color * sunlight, rays.alpha[:, None], rays.depth[:, None]], axis=1)
    cells = jnp.where(visible, cells, 0.0).reshape(region_px, region_px, 5)
    across = _overlaps(corner[0], side, region_px, width_px)
    down = _overlaps(corner[1], side, region_px, height_px)
    frame = jnp.einsum("hr,rsc,ws->hwc", down, cells, across)
    return Frame(color=frame[..., :3], alpha=frame[..., 3], depth=frame[..., 4])


def _region(field: Field, lens: Lens, r_KT_T: Array, R_KT: Array) -> tuple[Array, Array, Array]:
    """Corner [px] and side [px] of the square around the projected ball, and whether the ball is in front."""
    middle, radius = bounding_ball(field)
    center = jnp.sum(R_KT * (middle - r_KT_T)[None, :], axis=1)
    visible = center[2] > 1.01 * radius
    depth = jnp.where(visible, center[2], 2.0 * radius)
    tangent = center[:2] / depth
    focal = lens.focal_px.astype(jnp.float32)
    # An off-axis ball projects to an ellipse, longer than that of one on the axis by at most this factor.
    stretch = 1.0 + jnp.sum(tangent * tangent)
    half = _MARGIN * stretch * focal * radius / jnp.sqrt(depth * depth - radius * radius)
    pixel = lens.center_px.astype(jnp.float32) + focal * tangent
    return jax.lax.stop_gradient((pixel - half, 2.0 * half, visible))


def _region_rays(
    field: Field, lens: Lens, region_px: int, corner: Array, side: Array, r_KT_T: Array, R_KT: Array, sun_T: Array
) -> Rays:
    place = (jnp.arange(region_px, dtype=jnp.float32) + 0.5) * (side / region_px)
    center, focal = lens.center_px.astype(jnp.float32), lens.focal_px.astype(jnp.float32)
    x = jnp.broadcast_to(((corner[0] + place - center[0]) / focal)[None, :], (region_px, region_px)).reshape(-1)
    y = jnp.broadcast_to(((corner[1] + place - center[1]) / focal)[:, None], (region_px, region_px)).reshape(-1)
    scale = jax.lax.rsqrt(1.0 + x * x + y * y)
    direction_K = jnp.stack([x * scale, y * scale, scale], axis=1)
    direction_T = jnp.sum(direction_K[:, :, None] * R_KT[None, :, :], axis=1)
    shape = direction_T.shape
    return render_rays(
        field, jnp.broadcast_to(r_KT_T[None, :], shape), direction_T, jnp.broadcast_to(sun_T[None, :], shape)
    )


def _overlaps(corner: Array, side: Array, cells: int, pixels: int) -> Array:
    """(pixels, cells) share of each pixel that each cell of a row of `cells` covers."""
    width = side / cells
    start = corner + width * jnp.arange(cells, dtype=jnp.float32)
    pixel = jnp.arange(pixels, dtype=jnp.float32)
    first = jnp.maximum(pixel[:, None], start[None, :])
    last = jnp.minimum(pixel[:, None] + 1.0, (start + width)[None, :])
    return jnp.maximum(last - first, 0.0)


@pytree
class Exposure:
    """How a detector turns radiance into grey values.

    Attributes:
        gain: () exposure, 1 = white level of the field at full well
        full_well_e: () electrons at saturation
        read_noise_e: () 1 sigma [electrons]
        blur_px: () sigma of the point spread [px]
    """

    gain: Array
    full_well_e: Array
    read_noise_e: Array
    blur_px: Array


def expose(image: Image, exposure: Exposure, shot: Image, read: Image) -> Image:
    """Linear values (0 to 1, saturated) of a linear picture, from standard normal numbers for shot and read noise."""
    electrons = jnp.maximum(_blur(image, exposure.blur_px), 0.0) * (exposure.gain * exposure.full_well_e)
    noisy = electrons + jnp.sqrt(electrons + 1e-6) * shot + exposure.read_noise_e * read
    return jnp.clip(noisy / exposure.full_well_e, 0.0, 1.0)


def _blur(image: Array, sigma: Array) -> Array:
    """Gaussian blur over 7 x 7 pixels."""
    offset = jnp.arange(-3, 4, dtype=jnp.float32)
    kernel = jnp.exp(-0.5 * (offset / jnp.maximum(sigma, 1e-3)) ** 2)
    kernel = kernel / jnp.sum(kernel)
    height, width = image.shape[:2]
    padded = jnp.pad(image, ((3, 3), (0, 0), (0, 0)))
    down = sum((kernel[i] * padded[i : i + height] for i in range(7)), jnp.zeros_like(image))
    padded = jnp.pad(down, ((0, 0), (3, 3), (0, 0)))
    return sum((kernel[i] * padded[:, i : i + width] for i in range(7)), jnp.zeros_like(image))


def compose(frame: Frame, background: Image) -> Image:
    """Linear picture of a target before a background."""
    return frame.color + background * (1.0 - frame.alpha[:, :, None])
