"""Surface of few triangles that is like one of many: vertices of a cell of a grid become one, where their planes meet.

Rossignac and Borrel, Multi-resolution 3D Approximations for Rendering Complex Scenes, 1993; place of the vertex by
least squares of the distances from the planes: Lindstrom, Out-of-Core Simplification of Large Polygonal Models, 2000.
"""

from typing import Final

import numpy as np

_FINEST: Final = 400
"""Cells along the longest side of the first grid that is tried."""
_COARSENING: Final = 1.05
"""Side of a cell of the next grid over that of the one before."""
_FLAT: Final = 1e-3
"""Square of the singular value of planes over the largest, below which they leave a direction free."""


def clustered(triangles: np.ndarray, most: int, shift: float) -> tuple[np.ndarray, np.ndarray]:
    """At most `most` triangles (n, 3, 3) like those given (m, 3, 3), and the number (n,) of the one that each was.

    The grid is the finest that leaves few enough. Its first cell begins `shift` of a cell before the surface.
    """
    low = triangles.min(axis=(0, 1))
    side = float(np.ptp(triangles.reshape(-1, 3), axis=0).max()) / _FINEST
    while True:
        cluster, kept = _on_grid(triangles, low - shift * side, side)
        if len(kept) <= most:
            return _representatives(triangles, cluster)[cluster[kept]], kept
        side *= _COARSENING


def _on_grid(triangles: np.ndarray, low: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray]:
    """Cluster (m, 3) of each vertex of the triangles, and numbers (n,) of the triangles that are kept."""
    cells = np.floor((triangles.reshape(-1, 3) - low) / side).astype(np.int64)
    _, cluster = np.unique(cells, axis=0, return_inverse=True)
    cluster = cluster.reshape(-1, 3)
    corners = np.sort(cluster, axis=1)
    is_triangle = (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2])
    # Of several triangles between the same clusters one is enough, as either side of it counts.
    _, first = np.unique(np.where(is_triangle[:, None], corners, -1), axis=0, return_index=True)
    return cluster, np.sort(first[is_triangle[first]])


def _representatives(triangles: np.ndarray, cluster: np.ndarray) -> np.ndarray:
    """Vertex of each cluster: nearest to the planes of the triangles at its vertices, and then to these."""
    count = int(cluster.max()) + 1
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    middle, weight = np.zeros((count, 3)), np.zeros(count)
    np.add.at(middle, cluster.reshape(-1), triangles.reshape(-1, 3))
    np.add.at(weight, cluster.reshape(-1), 1.0)
    middle /= weight[:, None]
    A, b = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for corner in range(3):
        offset = np.sum(normals * (triangles[:, corner] - middle[cluster[:, corner]]), axis=1)
        np.add.at(A, cluster[:, corner], normals[:, :, None] * normals[:, None, :])
        np.add.at(b, cluster[:, corner], normals * offset[:, None])
    values, axes = np.linalg.eigh(A)
    is_held = values > _FLAT * np.maximum(values[:, -1:], 1e-300)
    along = np.einsum("nji,nj->ni", axes, b) * np.where(is_held, 1.0 / np.where(is_held, values, 1.0), 0.0)
    return middle + np.einsum("nij,nj->ni", axes, along)
