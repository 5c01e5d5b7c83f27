"""Distance of a point from a convex hull, which lies along the normal of a facet, or from an edge or a vertex."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.spatial import ConvexHull

from rpojax.core.numerics import gradient_safe
from rpojax.core.pytree import pytree

Vector = Float[Array, "3"]


@pytree
class HullFaces:
    """Which vertices of a hull make its facets and edges.

    Attributes:
        facets: (f, 3) int32, vertices of each triangle, outwards by the right hand
        edges: (e, 2) int32
    """

    facets: Array
    edges: Array


def faces_of(vertices: np.ndarray) -> HullFaces:
    """Facets and edges of the convex hull of vertices (n, 3)."""
    hull = ConvexHull(vertices)
    facets = hull.simplices.astype(np.int32)
    a, b, c = (vertices[facets[:, corner]] for corner in range(3))
    inwards = np.sum(np.cross(b - a, c - a) * hull.equations[:, :3], axis=1) < 0.0
    facets[inwards] = facets[inwards][:, ::-1]
    pairs = np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])
    return HullFaces(facets=jnp.asarray(facets), edges=jnp.asarray(np.unique(np.sort(pairs, axis=1), axis=0)))


def distance_from_hull(vertices: Float[Array, "n 3"], faces: HullFaces, point: Vector) -> Float[Array, ""]:
    """Distance [m] of a point from the convex hull of vertices [m]; inside, less the depth of the nearest facet.

    Along any direction the point is no farther from the hull than in truth, and as far along that to its nearest place.
    """
    a, b, c = (vertices[faces.facets[:, corner]] for corner in range(3))
    start, end = vertices[faces.edges[:, 0]], vertices[faces.edges[:, 1]]
    along = end - start
    square = jnp.sum(along * along, axis=1)
    share = jnp.clip(jnp.sum((point[None] - start) * along, axis=1) / square, 0.0, 1.0)
    from_edges = point[None] - (start + share[:, None] * along)
    directions = jnp.concatenate([_crosses(b - a, c - a), from_edges])
    # A direction of no length is that of a point on an edge, whose distance is 0.
    lengths = gradient_safe.sqrt(jnp.sum(directions * directions, axis=1))
    farthest = jnp.max(jnp.sum(directions[:, None, :] * vertices[None], axis=2), axis=1)
    beyond = jnp.sum(directions * point[None], axis=1) - farthest
    return jnp.max(jnp.where(lengths > 0.0, beyond / jnp.where(lengths > 0.0, lengths, 1.0), 0.0), axis=0)


def _crosses(a: Float[Array, "n 3"], b: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Cross products of rows."""
    x = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    y = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    z = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return jnp.stack([x, y, z], axis=1)
