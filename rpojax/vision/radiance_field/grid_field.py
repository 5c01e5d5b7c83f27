"""The field to fly: features on the nodes of a grid near the target's surface, and one network call per ray.

A ray gets a fixed number of samples, placed where a lookup says that there is matter; their features are summed, and
one small network turns the sum into a colour. It is told the surface's normal, the Sun, the half-vector and whether the
way to the Sun is free (deferred shading as in Hedman et al., "Baking Neural Radiance Fields", ICCV 2021).

Loops over samples are scans: batched, each of their steps is one vector operation over all rays, several times as fast
as cumulative sums and searches along a ray.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core.pytree import pytree, replace
from rpojax.vision.radiance_field.volume_rendering import (
    GAMMA,
    TINY,
    Layers,
    RenderedRays,
    apply_layers,
    normalized,
    positional_encoding,
    ray_box_intersection,
)

MARCH_STEPS = 80
"""Places along a ray at which a lookup tells whether there is matter."""
SAMPLES = 16
SHADOW_SAMPLES = 6
LATENT_SIZE = 8
FREQUENCIES = 4
SHADING_INPUTS = LATENT_SIZE + 3 + 3 + 3 + 9 + 6 * FREQUENCIES
"""Of the shading network."""
_EXTINCTION_CELLS = 2.5


@pytree
class GridField:
    """A field on the nodes of a grid that lie near the target's surface.

    Attributes:
        low: (3,) position of the first node [m]
        spacing: () distance of neighbouring nodes [m]
        row: (x, y, z) int32, row of a node in the tables; row 0 is empty space
        solid: (x, y, z) share in 0..1 by which a cell, named by its lowest node, holds matter: where samples go
        matter: (r,) density before its activation
        features: (r, 3 + LATENT) normal and what the network makes of the rest
        network: layers of the shading network
    """

    low: Array
    spacing: Array
    node_row: Array
    occupancy: Array
    raw_density: Array
    features: Array
    network: Layers


def grid_bounds(field: GridField) -> tuple[Array, Array]:
    """Lowest and highest corner (3,) of the grid [m]."""
    return field.low, field.low + field.spacing * (jnp.array(field.node_row.shape, jnp.float32) - 1.0)


def grid_density(field: GridField, point: Array) -> Array:
    """Density [1/m] at a point (3,) [m]."""
    rows, weights = _trilinear_nodes(field, point)
    return _activated_density(field, jnp.sum(weights * field.raw_density[rows]))


def _activated_density(field: GridField, raw_density: Array) -> Array:
    return jax.nn.softplus(raw_density) * (2.0 / field.spacing)


def _trilinear_nodes(field: GridField, point: Array) -> tuple[Array, Array]:
    """Rows (8,) of the nodes around a point (3,), and their trilinear weights."""
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
    """Whether a ray comes to a place where `grid_ray` would put samples; without one it brings nothing back."""
    march = _march(field, origin, direction)

    def running_maximum(maximum: Array, index: Array) -> tuple[Array, None]:
        return jnp.maximum(maximum, _occupancy_at(field, march, index)), None

    maximum, _ = jax.lax.scan(running_maximum, jnp.zeros((), jnp.float32), jnp.arange(MARCH_STEPS, dtype=jnp.float32))
    return (maximum > 0.0) & (march.step > 0.0)


def _sample_distances(
    field: GridField, origin: Array, direction: Array, samples: int, shift: Array
) -> tuple[Array, Array]:
    """Distances (samples,) along a ray where there is matter not yet hidden, and the length [m] each stands for."""
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
        share = (quantiles - before) / jnp.maximum(weight, 1e-12)
        here = (weight > 0.0) & (share >= 0.0) & (share < 1.0)
        distance = jnp.where(here, march.near + march.step * (index + share), distance)
        return (before + weight, distance, jnp.where(here, weight, mass)), None

    # A sample that rounding leaves without a step stands for no length, far away.
    start = (zero, jnp.broadcast_to(march.near, (samples,)), jnp.full((samples,), jnp.inf, jnp.float32))
    (_, distance, mass), _ = jax.lax.scan(invert_cumulative, start, (indices, weights))
    return jax.lax.stop_gradient((distance, march.step * total / (samples * mass)))


def _accumulate_samples(
    field: GridField, origin: Array, direction: Array, distance: Array, length: Array
) -> tuple[Array, ...]:
    """Optical depth of a ray's samples, and their features (3 + LATENT,) and distances [m] weighted by visibility."""

    def accumulate(
        carry: tuple[Array, Array, Array], sample: tuple[Array, Array]
    ) -> tuple[tuple[Array, Array, Array], None]:
        passed, features, depth = carry
        at, long = sample
        rows, corner = _trilinear_nodes(field, origin + at * direction)
        thickness = _activated_density(field, jnp.sum(corner * field.raw_density[rows])) * long
        weight = jnp.exp(-passed) * (1.0 - jnp.exp(-thickness))
        seen = weight * jnp.sum(corner[:, None] * field.features[rows], axis=0)
        return (passed + thickness, features + seen, depth + weight * at), None

    zero = jnp.zeros((), jnp.float32)
    start = (zero, jnp.zeros(field.features.shape[1:], jnp.float32), zero)
    return jax.lax.scan(accumulate, start, (distance, length))[0]


def _sun_transmittance(field: GridField, origin: Array, direction: Array) -> Array:
    """Share of light that reaches a point from a direction."""
    distance, length = _sample_distances(field, origin, direction, SHADOW_SAMPLES, jnp.zeros((), jnp.float32))

    def accumulate(passed: Array, sample: tuple[Array, Array]) -> tuple[Array, None]:
        return passed + grid_density(field, origin + sample[0] * direction) * sample[1], None

    return jnp.exp(-jax.lax.scan(accumulate, jnp.zeros((), jnp.float32), (distance, length))[0])


def render_grid_ray(field: GridField, origin: Array, direction: Array, sun: Array, shift: Array) -> RenderedRays:
    """What one ray brings back; `shift` in -0.5 to 0.5 moves its samples."""
    distance, length = _sample_distances(field, origin, direction, SAMPLES, shift)
    optical_depth, features, depth = _accumulate_samples(field, origin, direction, distance, length)
    alpha = 1.0 - jnp.exp(-optical_depth)
    inverse_alpha = 1.0 / (alpha + TINY)
    features, point = features * inverse_alpha, origin + depth * inverse_alpha * direction
    normal = normalized(features[:3])
    normal = jnp.where(jnp.sum(normal * direction) > 0.0, -normal, normal)
    # The derivative of a shadow by the density that casts it is left out: it costs more than the rest of the ray.
    transmittance = _sun_transmittance(
        *jax.lax.stop_gradient((field, point + 1.5 * field.spacing * (normal + sun), sun))
    )
    color = _shade(field, features[3:], point, normal, -direction, sun, transmittance)
    return RenderedRays(color=color * alpha, alpha=alpha, depth=depth, normal=normal * alpha)


def _shade(
    field: GridField, latent: Array, point: Array, normal: Array, view: Array, sun: Array, transmittance: Array
) -> Array:
    """Linear colour of a surface point: the network, fed with the terms that a shading formula would have."""
    half = normalized(view + sun)
    cosine, facing = jnp.sum(normal * sun), jnp.sum(normal * view)
    gloss = jnp.maximum(jnp.sum(normal * half), 0.0)
    lit = jax.nn.relu(cosine) * transmittance
    lobes = [transmittance * gloss**power for power in (8, 32, 128, 512)]
    low, high = grid_bounds(field)
    place = (2.0 * point - low - high) / jnp.sqrt(jnp.sum((high - low) ** 2))
    terms = jnp.stack([cosine, lit, transmittance, facing, gloss, *lobes])
    inputs = jnp.concatenate([latent, normal, view, sun, terms, positional_encoding(place, FREQUENCIES)])
    return jax.nn.sigmoid(apply_layers(field.network, inputs)) ** GAMMA


def number_near_nodes(near: np.ndarray) -> np.ndarray:
    """Rows (x, y, z) int32 of nodes by whether they are near the surface: 0 for those that are not, else 1, 2, ..."""
    row = np.zeros(near.shape, np.int32)
    row[near] = 1 + np.arange(int(near.sum()), dtype=np.int32)
    return row


def with_occupancy(field: GridField) -> GridField:
    """The field with its lookup of solid cells as the present matter has it."""
    thickness = _activated_density(field, field.raw_density) * field.spacing
    occupancy = jnp.where(thickness > 0.05, thickness / (0.5 + thickness), 0.0)[field.node_row]
    pooled = jax.lax.reduce_window(
        occupancy, jnp.zeros((), jnp.float32), jax.lax.max, (2, 2, 2), (1, 1, 1), ((0, 1), (0, 1), (0, 1))
    )
    return replace(field, occupancy=pooled)
