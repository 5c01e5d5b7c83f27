"""Loss of a radiance field: squared errors of sRGB codes and alpha, and smoothness of the features."""

from typing import Any

import jax
import jax.numpy as jnp

from rpojax.training.radiance_field.training_rays import TrainingRays
from rpojax.vision.imaging.srgb import linear_to_srgb
from rpojax.vision.radiance_field.grid_field import GridField
from rpojax.vision.radiance_field.target_field import RadianceField, render_rays

_ALPHA_WEIGHT = 0.5
_NEIGHBOUR_PAIRS = 8192
_SMOOTHNESS = 1e-2


def field_loss(
    field: RadianceField, rays: TrainingRays, chosen: jax.Array, jitter: jax.Array, neighbours: jax.Array
) -> jax.Array:
    """Loss over the chosen rays (n,), with `jitter` (n,) of their samples, and over pairs of neighbouring nodes."""
    color, alpha = mean_squared_errors(field, rays, chosen, jitter)
    return color + _ALPHA_WEIGHT * alpha + _smoothness_penalty(field, neighbours)


def mean_squared_errors(
    field: RadianceField, rays: TrainingRays, chosen: jax.Array, jitter: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Mean squared errors of sRGB codes and of alpha over the chosen rays."""
    view = rays.view[chosen]
    rendered = render_rays(field, rays.position[view], rays.direction[chosen], rays.sun[view], jitter)
    color_error = jnp.mean((linear_to_srgb(rendered.color) - rays.color[chosen]) ** 2)
    return color_error, jnp.mean((rendered.alpha - rays.alpha[chosen]) ** 2)


@jax.jit
def validation_error(field: RadianceField, rays: TrainingRays) -> jax.Array:
    """Mean squared error of sRGB codes over all rays, in parts of 1024."""
    part = min(1024, rays.view.shape[0])
    count = rays.view.shape[0] // part * part
    parts = jnp.arange(count, dtype=jnp.int32).reshape(-1, part)
    zero = jnp.zeros((part,), jnp.float32)
    return jnp.mean(jax.lax.map(lambda chosen: mean_squared_errors(field, rays, chosen, zero)[0], parts))


def random_neighbours(field: RadianceField, nodes: jax.Array, key: jax.Array) -> jax.Array:
    """Table rows (n, 2) of random pairs of neighbouring nodes; a pair with an empty node is (0, 0)."""
    if not isinstance(field, GridField):
        return jnp.zeros((1, 2), jnp.int32)
    limits = jnp.array(field.node_row.shape, jnp.int32)[None, :]
    place = nodes[jax.random.randint(key, (_NEIGHBOUR_PAIRS,), 0, nodes.shape[0], jnp.int32)]
    axis = jax.random.randint(jax.random.fold_in(key, 1), (_NEIGHBOUR_PAIRS,), 0, 3, jnp.int32)
    other = jnp.minimum(place + jnp.eye(3, dtype=jnp.int32)[axis], limits - 1)
    rows = jnp.stack([field.node_row[p[:, 0], p[:, 1], p[:, 2]] for p in (place, other)], axis=1)
    return jnp.where(jnp.any(rows == 0, axis=1, keepdims=True), 0, rows)


def _smoothness_penalty(field: RadianceField, neighbours: jax.Array) -> jax.Array:
    """Weighted mean squared difference of the latent features of neighbouring nodes."""
    if not isinstance(field, GridField):
        return jnp.zeros((), jnp.float32)
    pair = field.features[neighbours]
    return _SMOOTHNESS * jnp.mean((pair[:, 0] - pair[:, 1])[:, 3:] ** 2)


def trained_weights(field: RadianceField) -> dict[str, Any]:
    """Trained arrays of a field by name."""
    names = ("raw_density", "features", "network") if isinstance(field, GridField) else ("trunk", "head")
    return {name: getattr(field, name) for name in names}
