"""Which rays from points of a surface leave it without meeting a triangle."""

from collections.abc import Iterator
from functools import partial

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

_POINTS_AT_ONCE = 64


def free_directions(
    points: np.ndarray, normals: np.ndarray, triangles: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    """Whether a ray leaves the surface freely (points, directions): outwards, and without meeting a triangle.

    Args:
        points: (points, 3) on the surface [m]
        normals: (points, 3) unit vectors outwards
        triangles: (triangles, 3, 3) corners of the surface [m]; either side stops a ray
        directions: (directions, 3) unit vectors, in opposite pairs
    """
    span = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    starts, ahead, surface, rays = (
        each.astype(np.float32) for each in (points + _LIFT * span * normals, normals, triangles, directions)
    )
    counts, free = np.zeros(len(points), dtype=int), np.zeros((len(points), len(directions)), dtype=bool)
    for part, rows in _calls(np.arange(len(points))):
        counts[part] = np.asarray(_count_in_front(starts[rows], ahead[rows], surface))[: len(part)]
    # Points with about as many triangles are cast together, in few sizes, each of which is compiled once.
    sizes = np.where(counts <= 16, 16, 8 ** np.ceil(np.log2(np.maximum(counts, 512)) / 3.0).astype(int))
    for size in np.unique(sizes).tolist():
        for part, rows in _calls(np.flatnonzero(sizes == size)):
            free[part] = np.asarray(_cast(starts[rows], ahead[rows], surface, rays, size))[: len(part)]
    return free


def _calls(rows: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows of each call, and the same with the last one repeated until all calls are of one size."""
    for part in np.array_split(rows, -(-len(rows) // _POINTS_AT_ONCE)):
        yield part, part[np.minimum(np.arange(_POINTS_AT_ONCE), len(part) - 1)]


def _is_in_front(start: Float[Array, "3"], normal: Float[Array, "3"], triangles: Float[Array, "t 3 3"]) -> Array:
    """Whether each triangle reaches above the horizon of a point."""
    heights = [jnp.sum((triangles[:, corner] - start[None, :]) * normal[None, :], axis=1) for corner in range(3)]
    return jnp.maximum(jnp.maximum(heights[0], heights[1]), heights[2]) > 0.0


@jax.jit
def _count_in_front(
    starts: Float[Array, "p 3"], normals: Float[Array, "p 3"], triangles: Float[Array, "t 3 3"]
) -> Int[Array, " p"]:
    def at_point(inputs: tuple[Array, Array]) -> Array:
        return jnp.sum(_is_in_front(inputs[0], inputs[1], triangles), dtype=jnp.int32)

    return jax.lax.map(at_point, (starts, normals))


@partial(jax.jit, static_argnums=4)
def _cast(
    starts: Float[Array, "p 3"],
    normals: Float[Array, "p 3"],
    triangles: Float[Array, "t 3 3"],
    directions: Float[Array, "d 3"],
    size: int,
) -> Bool[Array, "p d"]:
    """Whether rays are free of at most `size` triangles in front of each point."""

    def from_point(inputs: tuple[Array, Array]) -> Array:
        start, normal = inputs
        (rows,) = jnp.nonzero(_is_in_front(start, normal, triangles), size=size, fill_value=-1)
        a, b, c = (triangles[rows, corner] - start[None, :] for corner in range(3))
        # A ray is inside of the cone of a triangle if it is on the same side of all its three planes.
        sides = [jnp.cross(a, b), jnp.cross(b, c), jnp.cross(c, a)]
        volume = jnp.sum(sides[0] * c, axis=1)
        is_edge_on = jnp.abs(volume) <= _EDGE_ON * _length(a) * _length(b) * _length(c)
        turn = jnp.where((rows < 0) | is_edge_on, 0.0, jnp.sign(volume))
        planes = [side * (turn / jnp.maximum(_length(side), 1e-30))[:, None] for side in sides]
        cosines = jnp.sum(directions * normal[None, :], axis=1)
        # At most half of the directions are above the horizon, as all come in opposite pairs.
        upper = jnp.argsort(-cosines)[: directions.shape[0] // 2]
        inside = (turn != 0.0)[None, :]
        for plane in planes:
            inside = inside & (_dots(directions[upper], plane) > -_EDGE_TOLERANCE)
        free = (cosines[upper] > 0.0) & ~jnp.any(inside, axis=1)
        return jnp.zeros(directions.shape[0], dtype=bool).at[upper].set(free)

    return jax.lax.map(from_point, (starts, normals))


def _length(vectors: Array) -> Array:
    return jnp.sqrt(jnp.sum(vectors * vectors, axis=1))


def _dots(directions: Array, planes: Array) -> Array:
    """Products (directions, planes), written out so that they are fused with what follows."""
    x, y, z = (directions[:, axis, None] * planes[None, :, axis] for axis in range(3))
    return x + y + z
