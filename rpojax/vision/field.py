"""The radiance field of a target: what a ray through its body axes T brings back, for any direction of the Sun.

Two fields stand behind the same two functions, `density` and `render_rays`. `GridField` is the one to fly: features on
the nodes of a grid near the surface, a fixed number of samples where matter is, and one network call per ray, which
is told the surface's normal, the Sun, the half-vector and whether the way to the Sun is free (deferred shading as
in Hedman et al., "Baking Neural Radiance Fields", ICCV 2021). `PointField` is the classic network of Mildenhall et al.,
"NeRF", ECCV 2020, at small size, kept for comparison.
"""

import itertools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.ndimage import binary_dilation
from scipy.spatial import KDTree

from rpojax.core.pytree import pytree, replace

Points = Float[Array, "n 3"]
Vector = Float[Array, "3"]
Scalar = Float[Array, ""]
Layers = tuple[tuple[Array, Array], ...]

STEPS = 80
"""Places along a ray at which a lookup tells whether there is matter."""
SAMPLES = 12
"""Samples of a ray through a grid."""
SHADOW_SAMPLES = 6
POINT_SAMPLES = 64
LATENT = 8
_POINT_FREQUENCIES = 4
_EMPTY = -10.0
_GAMMA = 2.2
_TINY = 1e-6
_DEPTH = 2.5


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
    row: Array
    solid: Array
    matter: Array
    features: Array
    network: Layers


@pytree
class PointField:
    """The reference field: one network from a point, a view and a Sun to density and colour.

    Attributes:
        low: (3,) lowest corner of the target's box [m]
        high: (3,) highest corner [m]
        trunk: layers from the encoded point to density and a feature vector
        head: layers from feature vector, view and Sun to colour
    """

    low: Array
    high: Array
    trunk: Layers
    head: Layers


Field = GridField | PointField


@pytree
class Rays:
    """What rays bring back.

    Attributes:
        color: (n, 3) linear radiance, 1 = white level, times alpha
        alpha: (n,) share that the target covers
        depth: (n,) distance [m] times alpha
        normal: (n, 3) unit normal towards the viewer in T; zero for a field without one
    """

    color: Array
    alpha: Array
    depth: Array
    normal: Array


@jax.jit
def density(field: Field, points_T: Points) -> Float[Array, " n"]:
    """Density [1/m] at points of T [m]; zero outside of the field's box."""
    if isinstance(field, GridField):
        return jax.vmap(lambda point: _grid_density(field, point[None, :])[0])(points_T)
    return jax.vmap(lambda point: _point_density(field, point))(points_T)


@jax.jit
def render_rays(
    field: Field, origins_T: Points, directions_T: Points, sun_T: Points, jitter: Float[Array, " n"] | None = None
) -> Rays:
    """Colour, alpha, depth and normal of rays with unit directions, each under the light of a Sun of its own.

    `jitter` (n,), in -0.5 to 0.5, shifts the samples of each ray for training. Differentiable in rays and Suns.
    """
    shift = jnp.zeros(origins_T.shape[:1], jnp.float32) if jitter is None else jitter
    one = _grid_ray if isinstance(field, GridField) else _point_ray
    return jax.vmap(lambda o, d, s, j: one(field, o, d, s, j))(origins_T, directions_T, sun_T, shift)  # pyright: ignore[reportArgumentType]


def bounding_ball(field: Field) -> tuple[Vector, Scalar]:
    """Middle [m] and radius [m] of the ball around the field's box."""
    low, high = _box(field)
    return 0.5 * (low + high), 0.5 * jnp.sqrt(jnp.sum((high - low) ** 2))


def _box(field: Field) -> tuple[Array, Array]:
    if isinstance(field, PointField):
        return field.low, field.high
    return field.low, field.low + field.spacing * (jnp.array(field.row.shape, jnp.float32) - 1.0)


def _crossing(low: Array, high: Array, origin: Array, direction: Array) -> tuple[Array, Array]:
    """Distances at which a ray enters and leaves a box; equal where it misses."""
    steep = jnp.where(jnp.abs(direction) < _TINY, _TINY, direction)
    first, second = (low - origin) / steep, (high - origin) / steep
    near = jnp.maximum(jnp.max(jnp.minimum(first, second)), 0.0)
    return near, jnp.maximum(jnp.min(jnp.maximum(first, second)), near)


def _normalized(vector: Array) -> Array:
    return vector * jax.lax.rsqrt(jnp.sum(vector * vector) + _TINY)


# The grid.


def _corners(field: GridField, points: Array) -> tuple[Array, Array]:
    """Rows (k, 8) of the nodes around points (k, 3), and their trilinear weights."""
    shape = field.row.shape
    place = (points - field.low[None, :]) / field.spacing
    inside = jnp.clip(place, 0.0, jnp.array(shape, jnp.float32)[None, :] - 1.001)
    first = jnp.floor(jax.lax.stop_gradient(inside)).astype(jnp.int32)
    share = inside - first.astype(jnp.float32)
    flat = (first[:, 0] * shape[1] + first[:, 1]) * shape[2] + first[:, 2]
    rows, weights = [], []
    for x in (0, 1):
        for y in (0, 1):
            for z in (0, 1):
                rows.append(flat + ((x * shape[1] + y) * shape[2] + z))
                parts = [share[:, axis] if bit else 1.0 - share[:, axis] for axis, bit in enumerate((x, y, z))]
                weights.append(parts[0] * parts[1] * parts[2])
    return field.row.reshape(-1)[jnp.stack(rows, axis=1)], jnp.stack(weights, axis=1)


def _activate(field: GridField, matter: Array) -> Array:
    return jax.nn.softplus(matter) * (2.0 / field.spacing)


def _grid_density(field: GridField, points: Array) -> Array:
    rows, weights = _corners(field, points)
    return _activate(field, jnp.sum(weights * field.matter[rows], axis=1))


def _place(field: GridField, origin: Array, direction: Array, samples: int, shift: Array) -> tuple[Array, Array]:
    """Distances (samples,) along a ray where there is matter not yet hidden, and the length [m] each stands for."""
    near, far = _crossing(*_box(field), origin, direction)
    step = (far - near) / STEPS
    at = near + step * (jnp.arange(STEPS, dtype=jnp.float32) + 0.5)
    shape = field.solid.shape
    position = origin[None, :] + at[:, None] * direction[None, :]
    cell = ((position - field.low[None, :]) / field.spacing).astype(jnp.int32)
    cell = jnp.clip(cell, 0, jnp.array(shape, jnp.int32)[None, :] - 1)
    found = field.solid.reshape(-1)[(cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]] * step
    hidden = (jnp.cumsum(found) - found) / (_DEPTH * field.spacing)
    # The floor keeps a few samples in what a first surface may or may not hide, such as a face seen at a grazing angle.
    weight = found * (jnp.exp(-hidden) + 0.02)
    total = jnp.cumsum(weight)
    wanted = (jnp.arange(samples, dtype=jnp.float32) + 0.5 + shift) * (total[-1] / samples)
    bin_ = jnp.minimum(jnp.sum(total[None, :] <= wanted[:, None], axis=1, dtype=jnp.int32), STEPS - 1)
    mass = jnp.maximum(weight[bin_], 1e-12)
    inside = jnp.clip((wanted - (total[bin_] - mass)) / mass, 0.0, 1.0)
    distance = near + step * (bin_.astype(jnp.float32) + inside)
    length = jnp.where(total[-1] > 0.0, step * total[-1] / (samples * mass), 0.0)
    return jax.lax.stop_gradient((distance, length))


def _opacity(sigma: Array, length: Array) -> tuple[Array, Array]:
    """Weights (k,) of samples in the colour of a ray, and what passes through all of them."""
    passed = jnp.cumsum(sigma * length)
    before = passed - sigma * length
    return jnp.exp(-before) * (1.0 - jnp.exp(-sigma * length)), jnp.exp(-passed[-1])


def _free_way(field: GridField, origin: Array, direction: Array) -> Array:
    """Share of light that reaches a point from a direction; its derivative by the density is left out."""
    distance, length = _place(field, origin, direction, SHADOW_SAMPLES, jnp.zeros((), jnp.float32))
    sigma = _grid_density(field, origin[None, :] + distance[:, None] * direction[None, :])
    return jnp.exp(-jnp.sum(sigma * length))


def _grid_ray(field: GridField, origin: Array, direction: Array, sun: Array, shift: Array) -> Rays:
    distance, length = _place(field, origin, direction, SAMPLES, shift)
    points = origin[None, :] + distance[:, None] * direction[None, :]
    rows, corner = _corners(field, points)
    sigma = _activate(field, jnp.sum(corner * field.matter[rows], axis=1))
    weight, passed = _opacity(sigma, length)
    alpha = 1.0 - passed
    share = weight / (alpha + _TINY)
    feature = jnp.sum((share[:, None] * corner)[:, :, None] * field.features[rows], axis=(0, 1))
    depth = jnp.sum(share * distance)
    point = origin + depth * direction
    normal = _normalized(feature[:3])
    normal = jnp.where(jnp.sum(normal * direction) > 0.0, -normal, normal)
    still = jax.lax.stop_gradient((field, point + 1.5 * field.spacing * (normal + sun), sun))
    free = _free_way(*still)
    color = _shade(field, feature[3:], point, normal, -direction, sun, free)
    return Rays(color=color * alpha, alpha=alpha, depth=depth * alpha, normal=normal * alpha)


def _shade(field: GridField, latent: Array, point: Array, normal: Array, view: Array, sun: Array, free: Array) -> Array:
    """Linear colour of a surface point: the network, fed with the terms that a shading formula would have."""
    half = _normalized(view + sun)
    cosine, facing = jnp.sum(normal * sun), jnp.sum(normal * view)
    gloss = jnp.maximum(jnp.sum(normal * half), 0.0)
    lit = jax.nn.relu(cosine) * free
    lobes = [free * gloss**power for power in (8, 32, 128, 512)]
    middle, radius = bounding_ball(field)
    place = (point - middle) / radius
    inputs = jnp.concatenate(
        [
            latent,
            normal,
            view,
            sun,
            jnp.stack([cosine, lit, free, facing, gloss, *lobes]),
            _encode(place, _POINT_FREQUENCIES),
        ]
    )
    return jax.nn.sigmoid(_apply(field.network, inputs)) ** _GAMMA


def _encode(point: Array, frequencies: int) -> Array:
    """Sines and cosines of a point (3,) at doubling frequencies."""
    scale = jnp.asarray(np.pi * 2.0 ** np.arange(frequencies), jnp.float32)
    angles = (scale[:, None] * point[None, :]).reshape(-1)
    return jnp.concatenate([jnp.sin(angles), jnp.cos(angles)])


def _apply(layers: Layers, inputs: Array) -> Array:
    values = inputs
    for index, (weight, bias) in enumerate(layers):
        values = values @ weight + bias
        if index < len(layers) - 1:
            values = jax.nn.relu(values)
    return values


# The reference.


def _trunk(field: PointField, point: Array) -> tuple[Array, Array]:
    low, high = field.low, field.high
    place = (2.0 * point - low - high) / jnp.max(high - low)
    values = _apply(field.trunk, jnp.concatenate([place, _encode(place, 6)]))
    inside = jnp.all((point >= low) & (point <= high))
    return jnp.where(inside, jax.nn.softplus(values[0]) * (100.0 / jnp.max(high - low)), 0.0), values[1:]


def _point_density(field: PointField, point: Array) -> Array:
    return _trunk(field, point)[0]


def _point_ray(field: PointField, origin: Array, direction: Array, sun: Array, shift: Array) -> Rays:
    near, far = _crossing(field.low, field.high, origin, direction)
    step = (far - near) / POINT_SAMPLES
    distance = near + step * (jnp.arange(POINT_SAMPLES, dtype=jnp.float32) + 0.5 + shift)
    sigma, feature = jax.vmap(lambda t: _trunk(field, origin + t * direction))(distance)
    weight, passed = _opacity(sigma, jnp.broadcast_to(step, (POINT_SAMPLES,)))
    head = jax.vmap(lambda f: _apply(field.head, jnp.concatenate([jax.nn.relu(f), direction, sun])))(feature)
    color = jnp.sum(weight[:, None] * jax.nn.sigmoid(head) ** _GAMMA, axis=0)
    return Rays(color=color, alpha=1.0 - passed, depth=jnp.sum(weight * distance), normal=jnp.zeros((3,), jnp.float32))


# Fresh fields.


def new_grid(surface: np.ndarray, normals: np.ndarray, key: Array, rows: int = 160_000) -> GridField:
    """A fresh field around points (n, 3) of a surface [m] with their normals, as fine as a number of rows allows."""
    low, high = surface.min(axis=0), surface.max(axis=0)
    spacing = _spacing(surface, low, high, rows)
    first, shape = _frame(low, high, spacing)
    row = number_nodes(_near(surface, first, spacing, shape))
    nodes = first + spacing * np.argwhere(row > 0)
    distance, nearest = KDTree(surface).query(nodes)
    # A sheet has two sides and either may be its front: one sign for both, for the viewer decides which is seen.
    facing = normals[nearest] * np.where(normals[nearest] @ [0.36, 0.48, 0.8] < 0.0, -1.0, 1.0)[:, None]
    count = len(nodes) + 1
    features = np.zeros((count, 3 + LATENT), np.float32)
    features[1:, :3] = facing
    features[1:, 3:] = 0.1 * np.asarray(jax.random.normal(jax.random.fold_in(key, 1), (count - 1, LATENT), jnp.float32))
    matter = np.full((count,), _EMPTY, np.float32)
    matter[1:] = np.clip(10.0 * (0.6 - distance / spacing), -6.0, 6.0)
    width = LATENT + 3 + 3 + 3 + 9 + 6 * _POINT_FREQUENCIES
    return with_solid(
        GridField(
            low=jnp.asarray(first, jnp.float32),
            spacing=jnp.asarray(spacing, jnp.float32),
            row=jnp.asarray(row),
            solid=jnp.zeros(shape, jnp.float32),
            matter=jnp.asarray(matter),
            features=jnp.asarray(features),
            network=_layers(key, (width, 64, 64, 3)),
        )
    )


def new_point(low: np.ndarray, high: np.ndarray, key: Array, width: int = 64) -> PointField:
    """A fresh reference field for the box between two corners [m]."""
    return PointField(
        low=jnp.asarray(low, jnp.float32),
        high=jnp.asarray(high, jnp.float32),
        trunk=_layers(jax.random.fold_in(key, 1), (39, width, width, width, width, 1 + width)),
        head=_layers(jax.random.fold_in(key, 2), (width + 6, 32, 3)),
    )


def with_solid(field: GridField) -> GridField:
    """The field with its lookup of solid cells as the present matter has it."""
    thickness = _activate(field, field.matter) * field.spacing
    share = jnp.where(thickness > 0.05, thickness / (0.5 + thickness), 0.0)[field.row]
    pooled = jax.lax.reduce_window(
        share, jnp.zeros((), jnp.float32), jax.lax.max, (2, 2, 2), (1, 1, 1), ((0, 1), (0, 1), (0, 1))
    )
    return replace(field, solid=pooled)


def number_nodes(near: np.ndarray) -> np.ndarray:
    """Rows (x, y, z) int32 of nodes by whether they are near the surface: 0 for those that are not, else 1, 2, ..."""
    row = np.zeros(near.shape, np.int32)
    row[near] = 1 + np.arange(int(near.sum()), dtype=np.int32)
    return row


def _layers(key: Array, widths: Sequence[int]) -> Layers:
    layers = []
    for index, (fan_in, fan_out) in enumerate(itertools.pairwise(widths)):
        scale = np.float32(np.sqrt(2.0 / fan_in))
        weight = scale * jax.random.normal(jax.random.fold_in(key, 100 + index), (fan_in, fan_out), jnp.float32)
        layers.append((weight, jnp.zeros((fan_out,), jnp.float32)))
    return tuple(layers)


def _frame(low: np.ndarray, high: np.ndarray, spacing: float) -> tuple[np.ndarray, tuple[int, ...]]:
    """First node [m] and numbers of nodes of a grid with a margin around a box."""
    first = low - 2.5 * spacing
    return first, tuple(int(n) for n in np.ceil((high + 2.5 * spacing - first) / spacing).astype(int) + 1)


def _near(surface: np.ndarray, first: np.ndarray, spacing: float, shape: tuple[int, ...]) -> np.ndarray:
    """Whether nodes (x, y, z) are corners of a cell that holds a point of the surface, or neighbours of such."""
    near = np.zeros(shape, bool)
    flat = np.unique(np.ravel_multi_index(tuple(np.floor((surface - first) / spacing).astype(np.int64).T), shape))
    cell = np.stack(np.unravel_index(flat, shape), axis=1)
    for corner in np.ndindex(2, 2, 2):
        near[tuple((cell + corner).T)] = True
    return binary_dilation(near)


def _spacing(surface: np.ndarray, low: np.ndarray, high: np.ndarray, rows: int) -> float:
    """Smallest spacing [m] with at most `rows` nodes near the surface, and 250 nodes on the longest side."""
    spacing = float((high - low).max()) / 250.0
    while _near(surface, *_arguments(low, high, spacing)).sum() >= rows:
        spacing *= 1.05
    return spacing


def _arguments(low: np.ndarray, high: np.ndarray, spacing: float) -> tuple[np.ndarray, float, tuple[int, ...]]:
    first, shape = _frame(low, high, spacing)
    return first, spacing, shape
