"""Surfaces of triangles for tests: boxes and spheres, and ray casting that is independent of the package's."""

import jax.numpy as jnp
import numpy as np

from rpojax.vision.surface import octahedral_map

_QUADS = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])


def box(center: tuple[float, float, float], size: tuple[float, float, float]) -> np.ndarray:
    """Twelve triangles (12, 3, 3) of a box, counter-clockwise from outside."""
    corners = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)])
    quads = (corners * size + center)[_QUADS]
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def sphere(radius: float, halvings: int = 3) -> np.ndarray:
    """Triangles (8 * 4^halvings, 3, 3) of a sphere from a halved octahedron, counter-clockwise from outside."""
    signs = np.array([[i, j, k] for i in (1.0, -1.0) for j in (1.0, -1.0) for k in (1.0, -1.0)])
    triangles = np.eye(3)[None] * signs[:, :, None]
    triangles = np.where((np.prod(signs, axis=1) < 0.0)[:, None, None], triangles[:, ::-1], triangles)
    for _ in range(halvings):
        a, b, c = np.moveaxis(triangles, 1, 0)
        ab, bc, ca = a + b, b + c, c + a
        triangles = np.concatenate(
            [np.stack(each, axis=1) for each in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
        triangles /= np.linalg.norm(triangles, axis=2, keepdims=True)
    return radius * triangles


def cells_of_rays(rays: np.ndarray, cells: int) -> np.ndarray:
    """Cells (n,) of the octahedral map for rays (n, 3)."""
    return np.asarray(octahedral_map.cell_of_direction(*(jnp.asarray(each) for each in rays.T), cells))


def meets(start: np.ndarray, direction: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether a ray meets a triangle (Moeller and Trumbore 1997)."""
    a, edges = triangles[:, 0], triangles[:, 1:] - triangles[:, :1]
    p = np.cross(direction, edges[:, 1])
    determinant = np.sum(edges[:, 0] * p, axis=1)
    valid = np.abs(determinant) > 1e-14
    inverse = 1.0 / np.where(valid, determinant, 1.0)
    offset = start - a
    q = np.cross(offset, edges[:, 0])
    u, v = np.sum(offset * p, axis=1) * inverse, (q @ direction) * inverse
    ahead = np.sum(edges[:, 1] * q, axis=1) * inverse > 1e-9
    return bool(np.any(valid & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & ahead))
