"""Initial grid field around a surface: its spacing, its nodes and their normals."""

import bisect

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.ndimage import binary_dilation
from scipy.spatial import KDTree

from rpojax.vision.multilayer_perceptron import Layers, initialize_layers
from rpojax.vision.radiance_field.deferred_shading import FILL_INPUTS, MATERIAL_OUTPUTS, SHADING_INPUTS
from rpojax.vision.radiance_field.grid_field import LATENT_SIZE, GridField, number_near_nodes
from rpojax.vision.radiance_field.occupancy_sampling import with_occupancy

_EMPTY_RAW_DENSITY = -10.0
_DIELECTRIC_LOGIT = -3.2


def initialize_grid(surface: np.ndarray, normals: np.ndarray, key: Array, rows: int = 160_000) -> GridField:
    """An untrained field around points (n, 3) of a surface [m] with their normals, as fine as `rows` nodes allow."""
    low, high = surface.min(axis=0), surface.max(axis=0)
    spacing = _choose_spacing(surface, low, high, rows)
    first, shape = _grid_extent(low, high, spacing)
    row = number_near_nodes(_nodes_near_surface(surface, first, spacing, shape))
    nodes = first + spacing * np.argwhere(row > 0)
    distance, nearest = KDTree(surface).query(nodes)
    # The two sides of a sheet have opposite normals; one sign for both, since rendering turns them to the viewer.
    facing = normals[nearest] * np.where(normals[nearest] @ [0.36, 0.48, 0.8] < 0.0, -1.0, 1.0)[:, None]
    count = len(nodes) + 1
    features = np.zeros((count, 3 + LATENT_SIZE), np.float32)
    features[1:, :3] = facing
    features[1:, 3:] = 0.1 * np.asarray(
        jax.random.normal(jax.random.fold_in(key, 1), (count - 1, LATENT_SIZE), jnp.float32)
    )
    raw_density = np.full((count,), _EMPTY_RAW_DENSITY, np.float32)
    raw_density[1:] = np.clip(10.0 * (0.6 - distance / spacing), -6.0, 6.0)
    return with_occupancy(
        GridField(
            low=jnp.asarray(first, jnp.float32),
            spacing=jnp.asarray(spacing, jnp.float32),
            node_row=jnp.asarray(row),
            occupancy=jnp.zeros(shape, jnp.float32),
            raw_density=jnp.asarray(raw_density),
            features=jnp.asarray(features),
            network=initialize_layers(key, (SHADING_INPUTS, 64, 64, 3)),
            material=_initial_material(jax.random.fold_in(key, 2)),
            fill_network=initialize_layers(jax.random.fold_in(key, 3), (FILL_INPUTS, 32, 3)),
        )
    )


def _initial_material(key: Array) -> Layers:
    """Layer to the material of a dull dielectric: 4 % of the light mirrored, roughness 0.5."""
    ((weight, bias),) = initialize_layers(key, (LATENT_SIZE, MATERIAL_OUTPUTS))
    return ((0.1 * weight, bias.at[:3].set(_DIELECTRIC_LOGIT)),)


def _grid_extent(low: np.ndarray, high: np.ndarray, spacing: float) -> tuple[np.ndarray, tuple[int, ...]]:
    """First node [m] and numbers of nodes of a grid with a margin around a box."""
    first = low - 2.5 * spacing
    return first, tuple(int(n) for n in np.ceil((high + 2.5 * spacing - first) / spacing).astype(int) + 1)


def _nodes_near_surface(surface: np.ndarray, first: np.ndarray, spacing: float, shape: tuple[int, ...]) -> np.ndarray:
    """Whether nodes (x, y, z) are corners of a cell that holds a point of the surface, or neighbours of one."""
    occupied = np.zeros(shape, bool)
    occupied[tuple(np.floor((surface - first) / spacing).astype(np.int64).T)] = True
    cell = np.argwhere(occupied)
    near = np.zeros(shape, bool)
    for corner in np.ndindex(2, 2, 2):
        near[tuple((cell + corner).T)] = True
    return binary_dilation(near)


def _choose_spacing(surface: np.ndarray, low: np.ndarray, high: np.ndarray, rows: int) -> float:
    """Spacing [m] with fewer than `rows` nodes near the surface, to 5 %, and at most 250 nodes on the longest side."""
    finest = float((high - low).max()) / 250.0

    def fits(power: int) -> bool:
        spacing = finest * 1.05**power
        first, shape = _grid_extent(low, high, spacing)
        return bool(_nodes_near_surface(surface, first, spacing, shape).sum() < rows)

    return finest * 1.05 ** bisect.bisect_left(range(80), True, key=fits)
