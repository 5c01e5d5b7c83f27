"""Lookup in a grid field: trilinear interpolation of density and features between the nodes around a point."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.vision.radiance_field.grid_field import GridField


def trilinear_nodes(field: GridField, point: Array) -> tuple[Array, Array]:
    """Table rows (8,) of the nodes around a point (3,) [m], and their trilinear weights (8,)."""
    shape = field.node_row.shape
    place = (point - field.low) / field.spacing
    inside = jnp.clip(place, 0.0, jnp.array(shape, jnp.float32) - 1.001)
    first = jnp.floor(jax.lax.stop_gradient(inside)).astype(jnp.int32)
    fraction = inside - first.astype(jnp.float32)
    flat = (first[0] * shape[1] + first[1]) * shape[2] + first[2]
    nodes, weights = [], []
    for corner in np.ndindex(2, 2, 2):
        nodes.append(flat + ((corner[0] * shape[1] + corner[1]) * shape[2] + corner[2]))
        parts = [fraction[axis] if bit else 1.0 - fraction[axis] for axis, bit in enumerate(corner)]
        weights.append(parts[0] * parts[1] * parts[2])
    return field.node_row.reshape(-1)[jnp.stack(nodes)], jnp.stack(weights)


def interpolate_density(field: GridField, rows: Array, weights: Array) -> Array:
    """Density [1/m] at the point of `trilinear_nodes`."""
    return activate_density(field, jnp.sum(weights * field.raw_density[rows]))


def interpolate_features(field: GridField, rows: Array, weights: Array) -> Array:
    """Features (3 + LATENT_SIZE,) at the point of `trilinear_nodes`."""
    return jnp.sum(weights[:, None] * field.features[rows], axis=0)


def activate_density(field: GridField, raw_density: Array) -> Array:
    """Density [1/m] of values as they are stored."""
    return jax.nn.softplus(raw_density) * (2.0 / field.spacing)


def grid_density(field: GridField, point: Array) -> Array:
    """Density [1/m] at a point (3,) [m]."""
    rows, weights = trilinear_nodes(field, point)
    return interpolate_density(field, rows, weights)
