"""Radiance field of a target: density, ray rendering and bounds in its body axes T, for a grid field or a NeRF."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.vision.radiance_field.grid_field import GridField, grid_bounds
from rpojax.vision.radiance_field.grid_interpolation import grid_density
from rpojax.vision.radiance_field.nerf_field import NerfField, nerf_density, nerf_intersects, render_nerf_ray
from rpojax.vision.radiance_field.occupancy_sampling import grid_intersects
from rpojax.vision.radiance_field.volume_rendering import RenderedRays, render_grid_ray

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
    """Whether rays with unit directions may hit the target; the others render as empty."""
    if isinstance(field, GridField):
        return jax.vmap(lambda o, d: grid_intersects(field, o, d))(origins_T, directions_T)
    return jax.vmap(lambda o, d: nerf_intersects(field, o, d))(origins_T, directions_T)


@jax.jit
def render_rays(
    field: RadianceField,
    origins_T: Points,
    directions_T: Points,
    sun_T: Points,
    fill_T: Points,
    jitter: Float[Array, " n"] | None = None,
) -> RenderedRays:
    """Colours, alpha, depth and normal of rays with unit directions.

    Each has its own unit vectors to the Sun and to the middle of the fill light. `jitter` (n,), in -0.5 to 0.5, shifts
    the samples of each ray for training. Differentiable in rays and lights.
    """
    shift = jnp.zeros(origins_T.shape[:1], jnp.float32) if jitter is None else jitter
    if isinstance(field, GridField):
        return jax.vmap(lambda *ray: render_grid_ray(field, *ray))(origins_T, directions_T, sun_T, fill_T, shift)
    return jax.vmap(lambda *ray: render_nerf_ray(field, *ray))(origins_T, directions_T, sun_T, fill_T, shift)


def bounds(field: RadianceField) -> tuple[Vector, Vector]:
    """Lowest and highest corner (3,) of the field's box in T [m], which is somewhat larger than the target."""
    return grid_bounds(field) if isinstance(field, GridField) else (field.low, field.high)


def bounding_sphere(field: RadianceField) -> tuple[Vector, Scalar]:
    """Centre [m] and radius [m] of the sphere around the field's box."""
    minimum, maximum = bounds(field)
    return 0.5 * (minimum + maximum), 0.5 * jnp.sqrt(jnp.sum((maximum - minimum) ** 2))
