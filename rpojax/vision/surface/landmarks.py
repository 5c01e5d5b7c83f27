"""Landmarks of a target: places of its surface that a camera recognises, and from where each of them can be seen."""

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from rpojax.core import quaternion
from rpojax.core.pytree import pytree
from rpojax.errors import RpojaxError
from rpojax.vision.surface import octahedral_map
from rpojax.vision.surface.ray_triangle_intersection import nearest_hits
from rpojax.vision.surface.surface_corners import body_size
from rpojax.vision.surface.surface_symmetries import Symmetry
from rpojax.vision.surface.visibility_table import CELLS

_LIFT = 1e-4
"""Height of the starts of rays above the surface, as a share of the body's size."""


class LandmarkError(RpojaxError):
    """Landmarks cannot be chosen, or do not fit their target."""


@pytree
class Landmarks:
    """Landmarks of a target, in its frame T.

    A symmetry turns the target about its origin by `symmetries[s]` and moves it by `shifts[s]`, and the target looks as
    before: landmark j then is where landmark `permutations[s, j]` was. The first symmetry is that of no turn.

    Attributes:
        positions: (n, 3) [m]
        normals: (n, 3) unit vectors outwards, mean of the faces around each
        visible: (cells^2, n) bool, whether each is free towards the directions of each cell of the octahedral map
        symmetries: (s, 4) unit quaternions
        shifts: (s, 3) [m]
        permutations: (s, n) int32
        port_position: (3,) middle of the docking port [m], None if there is none
        port_axis: (3,) unit vector out of the port, None if there is none
    """

    positions: Array
    normals: Array
    visible: Array
    symmetries: Array
    shifts: Array
    permutations: Array
    port_position: Array | None
    port_axis: Array | None


def are_free(
    visible: Bool[Array | np.ndarray, "cells n"], directions: Float[Array | np.ndarray, "n 3"]
) -> Bool[Array, " n"]:
    """Whether each landmark is free towards a direction of its own in T, of any length, by the table of `Landmarks`.

    Towards the camera this is whether it can be seen, towards the Sun whether it is lit.
    """
    cells = math.isqrt(visible.shape[0])
    x, y, z = (jnp.asarray(directions[:, axis]) for axis in range(3))
    cell = octahedral_map.cell_of_direction(x, y, z, cells)
    return jnp.asarray(visible)[cell, jnp.arange(visible.shape[1])]


def free_rays(positions: np.ndarray, normals: np.ndarray, triangles: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Whether rays along unit vectors (d, 3) from places (n, 3) of a surface meet none of its triangles (n, d).

    Unlike a facet, a corner is seen from more than the half space of its normal; rays start a little along it.
    """
    starts = positions + _LIFT * body_size(triangles) * normals
    found = [np.asarray(_free(triangles, start, directions)) for start in starts]
    return np.stack(found) if found else np.zeros((0, len(directions)), dtype=bool)


@jax.jit
def _free(triangles: Float[Array, "t 3 3"], start: Float[Array, "3"], directions: Float[Array, "d 3"]) -> Array:
    return jnp.isinf(nearest_hits(triangles, start, directions).distance)


def landmark_table(positions: np.ndarray, normals: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Whether each place (n, 3) of a surface is free towards the directions of each cell (cells^2, n).

    A place is hidden in a cell if it is so in a corner or the middle of the cell.
    """
    directions, of_cells = octahedral_map.cell_directions(CELLS)
    free = free_rays(positions, normals, triangles, directions)
    return np.asarray(free.T[of_cells].all(axis=1))


def with_symmetries(
    positions: np.ndarray,
    normals: np.ndarray,
    table: np.ndarray,
    symmetries: Sequence[Symmetry],
    port: tuple[np.ndarray, np.ndarray] | None,
) -> Landmarks:
    """Record of landmarks that the symmetries of their body exchange; `port` is its position [m] and its unit axis."""
    moved = np.stack([each.moved(positions) for each in symmetries])
    distances = np.linalg.norm(moved[:, :, None] - positions[None, None], axis=3)
    rotations = [quaternion.from_matrix(jnp.asarray(each.rotation)) for each in symmetries]
    return Landmarks(
        positions=jnp.asarray(positions),
        normals=jnp.asarray(normals),
        visible=jnp.asarray(table),
        symmetries=jnp.stack(rotations),
        shifts=jnp.asarray(np.stack([each.shift for each in symmetries])),
        permutations=jnp.asarray(np.argmin(distances, axis=2).astype(np.int32)),
        port_position=None if port is None else jnp.asarray(port[0]),
        port_axis=None if port is None else jnp.asarray(port[1]),
    )
