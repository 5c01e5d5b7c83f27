"""Image of a target: rays of a square region around it, averaged to the camera's pixels, over a background."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.pytree import pytree
from rpojax.vision.pinhole import Intrinsics
from rpojax.vision.radiance_field.image_region import project_region, region_directions
from rpojax.vision.radiance_field.ray_budget import RaySampling
from rpojax.vision.radiance_field.target_field import RadianceField, intersects, render_rays

Vector = Float[Array, "3"]
Matrix = Float[Array, "3 3"]
Image = Float[Array, "h w 3"]


@pytree
class Light:
    """Light on a target.

    Attributes:
        sun_T: (3,) unit vector to the Sun, in target axes
        sunlight: () fraction of the Sun's disc in view
        fill_T: (3,) unit vector to the middle of the fill light, which comes from a wide cone, in target axes
        fill: () irradiance of a surface that faces it, by the Sun's
    """

    sun_T: Array
    sunlight: Array
    fill_T: Array
    fill: Array


@pytree
class RenderedTarget:
    """Image of a target on black.

    Attributes:
        color: (h, w, 3) linear radiance, 1 = white level
        alpha: (h, w) fraction of the pixel that the target covers
        depth: (h, w) distance [m] times that fraction
    """

    color: Array
    alpha: Array
    depth: Array


def render_target(
    field: RadianceField,
    intrinsics: Intrinsics,
    width_px: int,
    height_px: int,
    sampling: RaySampling,
    r_KT_T: Vector,
    R_KT: Matrix,
    light: Light,
) -> RenderedTarget:
    """Image of the target from the camera's position [m] and axes, in T, under a light.

    Arrays are float32. Differentiable in pose and light.
    """
    corner, side, visible = project_region(field, intrinsics, r_KT_T, R_KT)
    direction = region_directions(intrinsics, sampling.side, corner, side, R_KT)
    cells = _render_square(field, sampling, r_KT_T, direction, light)
    cells = jnp.where(visible, cells, 0.0).reshape(sampling.side, sampling.side, 5)
    across = _pixel_coverage(corner[0], side, sampling.side, width_px)
    down = _pixel_coverage(corner[1], side, sampling.side, height_px)
    frame = jnp.einsum("hr,rsc,ws->hwc", down, cells, across)
    return RenderedTarget(color=frame[..., :3], alpha=frame[..., 3], depth=frame[..., 4])


def _render_square(
    field: RadianceField, sampling: RaySampling, origin: Array, directions: Array, light: Light
) -> Array:
    """Colour, alpha and depth (n, 5) of all rays of the square; only those that may hit the target are rendered."""

    def render(directions: Array) -> Array:
        origins, suns, fills = (
            jnp.broadcast_to(v[None, :], directions.shape) for v in (origin, light.sun_T, light.fill_T)
        )
        found = render_rays(field, origins, directions, suns, fills)
        color = light.sunlight * found.sunlit + light.fill * found.filled
        return jnp.concatenate([color, found.alpha[:, None], found.depth[:, None]], axis=1)

    if sampling.ray_count >= len(directions):
        return render(directions)
    may_hit = intersects(field, jnp.broadcast_to(origin[None, :], directions.shape), directions)
    (chosen,) = jnp.nonzero(may_hit, size=sampling.ray_count, fill_value=len(directions))
    found = render(directions.at[chosen].get(mode="clip"))
    return jnp.zeros((len(directions), 5), jnp.float32).at[chosen].set(found, mode="drop")


def _pixel_coverage(corner: Array, side: Array, cells: int, pixels: int) -> Array:
    """(pixels, cells) fraction of each pixel that each cell of a row of `cells` covers."""
    width = side / cells
    start = corner + width * jnp.arange(cells, dtype=jnp.float32)
    pixel = jnp.arange(pixels, dtype=jnp.float32)
    first = jnp.maximum(pixel[:, None], start[None, :])
    last = jnp.minimum(pixel[:, None] + 1.0, (start + width)[None, :])
    return jnp.maximum(last - first, 0.0)


def alpha_composite(frame: RenderedTarget, background: Image) -> Image:
    """Linear image of a target over a background."""
    return frame.color + background * (1.0 - frame.alpha[:, :, None])
