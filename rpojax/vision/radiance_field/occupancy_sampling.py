"""Sample placement along a ray by importance: samples go to occupied cells that are not yet hidden.

The loops over a ray are scans: batched, each of their steps is one vector operation over all rays, several times as
fast as cumulative sums and searches along a ray.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from rpojax.core.pytree import pytree, replace
from rpojax.vision.radiance_field.grid_field import GridField, grid_bounds
from rpojax.vision.radiance_field.grid_interpolation import activate_density
from rpojax.vision.radiance_field.ray_box_intersection import ray_box_intersection

MARCH_STEPS = 80
"""Places along a ray at which the occupancy is looked up."""
_EXTINCTION_CELLS = 2.5
"""Occupied length [cells] after which the weight of what is behind has fallen to 1/e."""


@pytree
class _RayMarch:
    """A ray's way through the box: where it enters [m], length of a step [m], first place and stride [cells]."""

    near: Array
    step: Array
    start: Array
    stride: Array


def _march(field: GridField, origin: Array, direction: Array) -> _RayMarch:
    near, far = ray_box_intersection(*grid_bounds(field), origin, direction)
    step = (far - near) / MARCH_STEPS
    start = (origin + (near + 0.5 * step) * direction - field.low) / field.spacing
    return _RayMarch(near=near, step=step, start=start, stride=direction * step / field.spacing)


def _occupancy_at(field: GridField, march: _RayMarch, index: Array) -> Array:
    shape = field.occupancy.shape
    cell = [
        jnp.clip((march.start[axis] + index * march.stride[axis]).astype(jnp.int32), 0, shape[axis] - 1)
        for axis in range(3)
    ]
    return field.occupancy.reshape(-1)[(cell[0] * shape[1] + cell[1]) * shape[2] + cell[2]]


def grid_intersects(field: GridField, origin: Array, direction: Array) -> Array:
    """Whether a ray passes an occupied cell; without one it renders as empty."""
    march = _march(field, origin, direction)

    def running_maximum(maximum: Array, index: Array) -> tuple[Array, None]:
        return jnp.maximum(maximum, _occupancy_at(field, march, index)), None

    maximum, _ = jax.lax.scan(running_maximum, jnp.zeros((), jnp.float32), jnp.arange(MARCH_STEPS, dtype=jnp.float32))
    return (maximum > 0.0) & (march.step > 0.0)


def sample_distances(
    field: GridField, origin: Array, direction: Array, samples: int, shift: Array
) -> tuple[Array, Array]:
    """Distances (samples,) of samples along a ray [m], and the length [m] that each stands for.

    The samples invert the cumulative weight of the occupied steps; `shift` in -0.5 to 0.5 moves all of them.
    """
    march = _march(field, origin, direction)
    zero = jnp.zeros((), jnp.float32)
    indices = jnp.arange(MARCH_STEPS, dtype=jnp.float32)

    def sampling_weight(passed: Array, index: Array) -> tuple[Array, Array]:
        here = _occupancy_at(field, march, index) * march.step
        # The floor keeps a few samples in what a first surface may or may not hide, such as a face at a grazing angle.
        return passed + here, here * (jnp.exp(-passed / (_EXTINCTION_CELLS * field.spacing)) + 0.02)

    _, weights = jax.lax.scan(sampling_weight, zero, indices)
    total = jnp.sum(weights)
    quantiles = (jnp.arange(samples, dtype=jnp.float32) + 0.5 + shift) * (total / samples)

    def invert_cumulative(
        carry: tuple[Array, Array, Array], step: tuple[Array, Array]
    ) -> tuple[tuple[Array, Array, Array], None]:
        before, distance, mass = carry
        index, weight = step
        fraction = (quantiles - before) / jnp.maximum(weight, 1e-12)
        here = (weight > 0.0) & (fraction >= 0.0) & (fraction < 1.0)
        distance = jnp.where(here, march.near + march.step * (index + fraction), distance)
        return (before + weight, distance, jnp.where(here, weight, mass)), None

    # A sample that rounding leaves without a step keeps an infinite mass, so that it stands for no length.
    start = (zero, jnp.broadcast_to(march.near, (samples,)), jnp.full((samples,), jnp.inf, jnp.float32))
    (_, distance, mass), _ = jax.lax.scan(invert_cumulative, start, (indices, weights))
    return jax.lax.stop_gradient((distance, march.step * total / (samples * mass)))


@jax.jit
def with_occupancy(field: GridField) -> GridField:
    """The field with the occupancy of its present density: the maximum over the nodes of each cell."""
    thickness = activate_density(field, field.raw_density) * field.spacing
    occupancy = jnp.where(thickness > 0.05, thickness / (0.5 + thickness), 0.0)[field.node_row]
    pooled = jax.lax.reduce_window(
        occupancy, jnp.zeros((), jnp.float32), jax.lax.max, (2, 2, 2), (1, 1, 1), ((0, 1), (0, 1), (0, 1))
    )
    return replace(field, occupancy=pooled)
