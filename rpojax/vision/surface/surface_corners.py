"""Corners of a triangle mesh: places that a picture shows as a point and not as a line or a smooth area.

At a corner the angles of the triangles around a vertex do not add up to a full turn. What they lack is the angle
defect, the curvature that the vertex stands for: zero in a plane and along a straight edge, and small on a smooth body,
however it is cut into triangles (Botsch et al., Polygon Mesh Processing, 2010, chapter 3).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

LEAST_DEFECT: Final = np.radians(30.0)
"""Angle defect of a corner: 90 deg at that of a box, 11 deg along the rim of a cylinder of 32 sides."""
_WELD: Final = 1e-5
"""Vertices this near, as a share of the body's size, are one."""


@dataclass(frozen=True)
class Corners:
    """Corners of a mesh.

    Attributes:
        positions: (n, 3) [m]
        normals: (n, 3) unit vectors outwards: mean of the faces around each, weighted by their angles at the corner
        defects: (n,) size of the angle defect [rad]
    """

    positions: np.ndarray
    normals: np.ndarray
    defects: np.ndarray


def body_size(triangles: np.ndarray) -> float:
    """Diagonal [m] of the box around triangles (t, 3, 3) [m]."""
    points = triangles.reshape(-1, 3)
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def corners(triangles: np.ndarray) -> Corners:
    """Corners of the surface of triangles (t, 3, 3) [m], counter-clockwise from outside."""
    positions, faces = _welded(triangles)
    angles, normals = _angles(positions[faces])
    count = len(positions)
    turn = np.bincount(faces.ravel(), weights=angles.ravel(), minlength=count)
    defects = np.abs(2.0 * np.pi - turn)
    # Along the edge of an open surface half a turn is straight, and where a vertex divides only one of two sides.
    defects = np.where(_on_open_edge(faces, count), np.minimum(defects, np.abs(np.pi - turn)), defects)
    weighted = (angles[:, :, None] * normals[:, None, :]).reshape(-1, 3)
    sums = np.stack([np.bincount(faces.ravel(), weights=column, minlength=count) for column in weighted.T], axis=1)
    lengths = np.linalg.norm(sums, axis=1)
    is_corner = (defects > LEAST_DEFECT) & (lengths > 1e-6)
    return Corners(positions[is_corner], sums[is_corner] / lengths[is_corner, None], defects[is_corner])


def _welded(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct vertices (v, 3), and those of each triangle (t, 3); triangles of less than three are left out."""
    points = triangles.reshape(-1, 3)
    cells = np.round((points - points.min(axis=0)) / (_WELD * body_size(triangles))).astype(np.int64)
    _, first, numbers = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    faces = numbers.reshape(-1, 3)
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return points[first], faces[distinct]


def _angles(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles (t, 3) [rad] at the corners of triangles, and their unit normals (t, 3), zero where there is no area."""
    ahead, behind = triangles[:, [1, 2, 0]] - triangles, triangles[:, [2, 0, 1]] - triangles
    across = np.cross(ahead, behind)
    doubled = np.linalg.norm(across, axis=2)
    angles = np.arctan2(doubled, np.sum(ahead * behind, axis=2))
    return angles, across[:, 0] / np.maximum(doubled[:, :1], 1e-300)


def _on_open_edge(faces: np.ndarray, count: int) -> np.ndarray:
    """Whether each of `count` vertices is on an edge of a single triangle."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, uses = np.unique(edges, axis=0, return_counts=True)
    open_ = np.zeros(count, dtype=bool)
    open_[unique[uses == 1].ravel()] = True
    return open_
