"""Octahedral map: the sphere of directions unfolded to a square grid, whose cell is found without trigonometry.

Cigolle et al., A Survey of Efficient Representations for Independent Unit Vectors, JCGT 3(2), 2014.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int


def cell_directions(cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (n, 3) at the corners and in the middles of `cells` by `cells` cells; the five (cells^2, 5) of each.

    `cells` is even, so that the folds of the map lie between cells; a corner that cells share is listed once.
    """
    corners, numbers = corner_directions(cells)
    middles = corners[numbers].sum(axis=1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    own = len(corners) + np.arange(len(middles))[:, None]
    return np.concatenate([corners, middles]), np.concatenate([numbers, own], axis=1)


def corner_directions(cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (n, 3) at the corners of cells, and the four (cells^2, 4) of each."""
    places = np.arange(cells + 1)
    # In whole numbers, so that the two images of a direction on the border are recognised as one.
    u, v = np.meshgrid(2 * places - cells, 2 * places - cells, indexing="ij")
    height = cells - np.abs(u) - np.abs(v)
    fold = np.maximum(-height, 0)
    x, y = u - np.where(u >= 0, fold, -fold), v - np.where(v >= 0, fold, -fold)
    unique, numbers = np.unique(np.stack([x, y, height], axis=-1).reshape(-1, 3), axis=0, return_inverse=True)
    numbers = numbers.reshape(cells + 1, cells + 1)
    corners = np.stack([numbers[:-1, :-1], numbers[1:, :-1], numbers[:-1, 1:], numbers[1:, 1:]], axis=-1)
    return unique / np.linalg.norm(unique, axis=1, keepdims=True), corners.reshape(cells * cells, 4)


def cell_of_direction(
    x: Float[Array, "..."], y: Float[Array, "..."], z: Float[Array, "..."], cells: int
) -> Int[Array, "..."]:
    """Number of the cell of directions of any length, by their components."""
    scale = 1.0 / (jnp.abs(x) + jnp.abs(y) + jnp.abs(z))
    u, v = x * scale, y * scale
    folded_u, folded_v = (1.0 - jnp.abs(v)) * _sign(u), (1.0 - jnp.abs(u)) * _sign(v)
    u, v = jnp.where(z >= 0.0, u, folded_u), jnp.where(z >= 0.0, v, folded_v)
    return _place(u, cells) * cells + _place(v, cells)


def _sign(value: Array) -> Array:
    return jnp.where(value >= 0.0, 1.0, -1.0).astype(value.dtype)


def _place(value: Array, cells: int) -> Array:
    """Number of the cell along one axis of the square from -1 to 1."""
    return jnp.clip((0.5 * cells * (value + 1.0)).astype(jnp.int32), 0, cells - 1)
