"""The radiance field of a target: what a ray through its body axes T brings back, for any direction of the Sun.

Two kinds of field stand behind the same functions: the grid to fly, and the classic network kept for comparison.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.vision.radiance_field.grid_field import (
    GridField,
    grid_bounds,
    grid_density,
    grid_intersects,
    render_grid_ray,
)
from rpojax.vision.radiance_field.nerf_field import NerfField, nerf_density, nerf_intersects, render_nerf_ray
from rpojax.vision.radiance_field.volume_rendering import RenderedRays

Points = Float[Array, "n 3"]
Vector = Float[Array, "3"]
Scalar = Float[Array, ""]

RadianceField = GridField | NerfField


@jax.jit
def density(field: RadianceField, points_T: Points) -> Float[Array, " n"]:
    """Density [1/m] at points of T [m]; zero outside of the field's box."""
    if isinstance(field, GridField):
        return jax.vmap(lambda point: grid_density(field, point))(points_T)
    return jax.vmap(lambda point: nerf_density(field, point))(points_T)


@jax.jit
def intersects(field: RadianceField, origins_T: Points, directions_T: Points) -> Bool[Array, " n"]:
    """Whether rays with unit directions come near matter; those that do not bring nothing back."""
    if isinstance(field, GridField):
        return jax.vmap(lambda o, d: grid_intersects(field, o, d))(origins_T, directions_T)
    return jax.vmap(lambda o, d: nerf_intersects(field, o, d))(origins_T, directions_T)


@jax.jit
def render_rays(
    field: RadianceField,
    origins_T: Points,
    directions_T: Points,
    sun_T: Points,
    jitter: Float[Array, " n"] | None = None,
) -> RenderedRays:
    """Colour, alpha, depth and normal of rays with unit directions, each under the light of a Sun of its own.

    `jitter` (n,), in -0.5 to 0.5, shifts the samples of each ray for training. Differentiable in rays and Suns.
    """
    shift = jnp.zeros(origins_T.shape[:1], jnp.float32) if jitter is None else jitter
    if isinstance(field, GridField):
        return jax.vmap(lambda o, d, s, j: render_grid_ray(field, o, d, s, j))(origins_T, directions_T, sun_T, shift)
    return jax.vmap(lambda o, d, s, j: render_nerf_ray(field, o, d, s, j))(origins_T, directions_T, sun_T, shift)


def bounding_sphere(field: RadianceField) -> tuple[Vector, Scalar]:
    """Middle [m] and radius [m] of the ball around the field's box."""
    minimum, maximum = grid_bounds(field) if isinstance(field, GridField) else (field.low, field.high)
    return 0.5 * (minimum + maximum), 0.5 * jnp.sqrt(jnp.sum((maximum - minimum) ** 2))
