"""A fresh grid around a surface: how fine, which nodes, and the normals that they start with."""

import bisect

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.ndimage import binary_dilation
from scipy.spatial import KDTree

from rpojax.vision.radiance_field.grid_field import (
    LATENT_SIZE,
    SHADING_INPUTS,
    GridField,
    number_near_nodes,
    with_occupancy,
)
from rpojax.vision.radiance_field.volume_rendering import initialize_layers

_EMPTY_RAW_DENSITY = -10.0


def initialize_grid(surface: np.ndarray, normals: np.ndarray, key: Array, rows: int = 160_000) -> GridField:
    """A fresh field around points (n, 3) of a surface [m] with their normals, as fine as a number of rows allows."""
    low, high = surface.min(axis=0), surface.max(axis=0)
    spacing = _choose_spacing(surface, low, high, rows)
    first, shape = _grid_extent(low, high, spacing)
    row = number_near_nodes(_nodes_near_surface(surface, first, spacing, shape))
    nodes = first + spacing * np.argwhere(row > 0)
    distance, nearest = KDTree(surface).query(nodes)
    # A sheet has two sides and either may be its front: one sign for both, for the viewer decides which is seen.
    facing = normals[nearest] * np.where(normals[nearest] @ [0.36, 0.48, 0.8] < 0.0, -1.0, 1.0)[:, None]
    count = len(nodes) + 1
    features = np.zeros((count, 3 + LATENT_SIZE), np.float32)
    features[1:, :3] = facing
    features[1:, 3:] = 0.1 * np.asarray(
        jax.random.normal(jax.random.fold_in(key, 1), (count - 1, LATENT_SIZE), jnp.float32)
    )
    matter = np.full((count,), _EMPTY_RAW_DENSITY, np.float32)
    matter[1:] = np.clip(10.0 * (0.6 - distance / spacing), -6.0, 6.0)
    return with_occupancy(
        GridField(
            low=jnp.asarray(first, jnp.float32),
            spacing=jnp.asarray(spacing, jnp.float32),
            node_row=jnp.asarray(row),
            occupancy=jnp.zeros(shape, jnp.float32),
            raw_density=jnp.asarray(matter),
            features=jnp.asarray(features),
            network=initialize_layers(key, (SHADING_INPUTS, 64, 64, 3)),
        )
    )


def _grid_extent(low: np.ndarray, high: np.ndarray, spacing: float) -> tuple[np.ndarray, tuple[int, ...]]:
    """First node [m] and numbers of nodes of a grid with a margin around a box."""
    first = low - 2.5 * spacing
    return first, tuple(int(n) for n in np.ceil((high + 2.5 * spacing - first) / spacing).astype(int) + 1)


def _nodes_near_surface(surface: np.ndarray, first: np.ndarray, spacing: float, shape: tuple[int, ...]) -> np.ndarray:
    """Whether nodes (x, y, z) are corners of a cell that holds a point of the surface, or neighbours of such."""
    held = np.zeros(shape, bool)
    held[tuple(np.floor((surface - first) / spacing).astype(np.int64).T)] = True
    cell = np.argwhere(held)
    near = np.zeros(shape, bool)
    for corner in np.ndindex(2, 2, 2):
        near[tuple((cell + corner).T)] = True
    return binary_dilation(near)


def _choose_spacing(surface: np.ndarray, low: np.ndarray, high: np.ndarray, rows: int) -> float:
    """Spacing [m] with fewer than `rows` nodes near the surface, to 5 %, and at most 250 nodes on the longest side."""
    finest = float((high - low).max()) / 250.0
    fits = range(80)
    best = bisect.bisect_left(
        fits,
        True,
        key=lambda power: (
            _nodes_near_surface(surface, *_extent_arguments(low, high, finest * 1.05**power)).sum() < rows
        ),
    )
    return finest * 1.05**best


def _extent_arguments(low: np.ndarray, high: np.ndarray, spacing: float) -> tuple[np.ndarray, float, tuple[int, ...]]:
    first, shape = _grid_extent(low, high, spacing)
    return first, spacing, shape
