"""Which rays from points of a surface leave it without meeting a triangle."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

_EDGE_TOLERANCE = 1e-5
"""Angle [rad] beyond an edge within which a ray still meets the triangle, so that none slips between two of them."""
_EDGE_ON = 1e-7
"""Triple product of the unit vectors to the corners of a triangle below which it is seen edge-on and stops no ray."""
_LIFT = 1e-4
"""Height of the starts of rays above the surface, as a fraction of the surface's span."""

_POINTS_AT_ONCE = 256


def free_directions(
    points: np.ndarray, normals: np.ndarray, triangles: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    """Whether a ray leaves the surface freely (points, directions): outwards, and without meeting a triangle.

    Args:
        points: (points, 3) on the surface [m]
        normals: (points, 3) unit vectors outwards
        triangles: (triangles, 3, 3) corners of the surface [m]; either side stops a ray
        directions: (directions, 3) unit vectors
    """
    span = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    starts = points + _LIFT * span * normals
    before = _in_front(starts, normals, triangles)
    most = max(1, *(len(each) for each in before))
    surface, rays = triangles.astype(np.float32), directions.astype(np.float32)
    found = []
    for first in range(0, len(points), _POINTS_AT_ONCE):
        # The last points are repeated until they fill a call, so that all calls have one size.
        rows = np.minimum(np.arange(first, first + _POINTS_AT_ONCE), len(points) - 1)
        numbers = np.full((len(rows), most), -1, dtype=np.int32)
        for row, each in zip(numbers, (before[row] for row in rows), strict=True):
            row[: len(each)] = each
        ahead = (starts[rows].astype(np.float32), normals[rows].astype(np.float32))
        found.append(np.asarray(_cast(numbers, *ahead, surface, rays))[: len(points) - first])
    return np.concatenate(found)


def _in_front(starts: np.ndarray, normals: np.ndarray, triangles: np.ndarray) -> list[np.ndarray]:
    """For each point the numbers of the triangles that reach above its horizon."""
    corners = np.moveaxis(triangles.astype(np.float32), (1, 2), (0, 1))
    found = []
    for rows in np.array_split(np.arange(len(starts)), -(-len(starts) // _POINTS_AT_ONCE)):
        ahead = normals[rows].astype(np.float32)
        heights = np.maximum(np.maximum(ahead @ corners[0], ahead @ corners[1]), ahead @ corners[2])
        level = np.sum(starts[rows] * normals[rows], axis=1, keepdims=True).astype(np.float32)
        found += [np.flatnonzero(each).astype(np.int32) for each in heights > level]
    return found


@jax.jit
def _cast(
    before: Int[Array, "p n"],
    starts: Float[Array, "p 3"],
    normals: Float[Array, "p 3"],
    triangles: Float[Array, "t 3 3"],
    directions: Float[Array, "d 3"],
) -> Bool[Array, "p d"]:
    def from_point(inputs: tuple[Array, Array, Array]) -> Array:
        rows, start, normal = inputs
        a, b, c = (triangles[rows, corner] - start[None, :] for corner in range(3))
        # A ray is inside of the cone of a triangle if it is on the same side of all its three planes.
        sides = [jnp.cross(a, b), jnp.cross(b, c), jnp.cross(c, a)]
        volume = jnp.sum(sides[0] * c, axis=1)
        is_edge_on = jnp.abs(volume) <= _EDGE_ON * _length(a) * _length(b) * _length(c)
        turn = jnp.where((rows < 0) | is_edge_on, 0.0, jnp.sign(volume))
        planes = [side * (turn / jnp.maximum(_length(side), 1e-30))[:, None] for side in sides]
        inside = (turn != 0.0)[None, :]
        for plane in planes:
            inside = inside & (_dots(directions, plane) > -_EDGE_TOLERANCE)
        return (jnp.sum(directions * normal[None, :], axis=1) > 0.0) & ~jnp.any(inside, axis=1)

    return jax.lax.map(from_point, (before, starts, normals))


def _length(vectors: Array) -> Array:
    return jnp.sqrt(jnp.sum(vectors * vectors, axis=1))


def _dots(directions: Array, planes: Array) -> Array:
    """Products (directions, planes), written out so that they are fused with what follows."""
    x, y, z = (directions[:, axis, None] * planes[None, :, axis] for axis in range(3))
    return x + y + z
