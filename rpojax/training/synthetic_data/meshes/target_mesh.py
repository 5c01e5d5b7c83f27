"""Triangle mesh of a target in body axes T, with its surface points, outline and apparent size."""

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation


@dataclasses.dataclass(frozen=True)
class Material:
    """Reflection of a surface: linear base colour, metallic, roughness; a texture (8 bit sRGB) replaces the colour."""

    color: tuple[float, float, float] = (0.5, 0.5, 0.5)
    metallic: float = 0.0
    roughness: float = 0.5
    texture: np.ndarray | None = None


@dataclasses.dataclass(frozen=True)
class MeshPart:
    """Triangles of one material: vertices (n, 3) [m], faces (m, 3), texture coordinates (n, 2) if there is one."""

    vertices: np.ndarray
    faces: np.ndarray
    material: Material
    uv: np.ndarray | None = None


@dataclasses.dataclass(frozen=True)
class TargetMesh:
    """Mesh of a target in body axes T, in parts by material.

    Attributes:
        name: that of its file
        parts: triangles of one material each
        notes: what of its file is not used, or is read in another way than it says: a line for each kind
    """

    name: str
    parts: tuple[MeshPart, ...]
    notes: tuple[str, ...] = ()

    @property
    def vertices(self) -> np.ndarray:
        """All vertices (n, 3) [m]."""
        return np.concatenate([part.vertices for part in self.parts])

    @property
    def face_count(self) -> int:
        """Number of triangles."""
        return sum(len(part.faces) for part in self.parts)

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) lowest and highest corner [m]."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def surface_points(self, spacing_m: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Random points (n, 3) [m] of the surface and its normals (n, 3), a dozen per square of side `spacing_m`."""
        rng = np.random.default_rng(seed)
        points, normals = [], []
        for part in self.parts:
            a, b, c = (part.vertices[part.faces[:, i]] for i in range(3))
            normal = np.cross(b - a, c - a)
            area = 0.5 * np.linalg.norm(normal, axis=1)
            count = rng.poisson(12.0 * area / spacing_m**2)
            count = np.maximum(count, 1)
            face = np.repeat(np.arange(len(area)), count)
            u, v = rng.random((2, len(face), 1))
            folded = u + v > 1.0
            u, v = np.where(folded, 1.0 - u, u), np.where(folded, 1.0 - v, v)
            points.append(a[face] + u * (b - a)[face] + v * (c - a)[face])
            normals.append((normal / (2.0 * area[:, None]))[face])
        return np.concatenate(points), np.concatenate(normals)


def outline_vertices(mesh: TargetMesh, max_vertices: int = 64) -> np.ndarray:
    """Vertices (n, 3) [m] that span the outline: the farthest in `max_vertices` directions all round."""
    index = np.arange(max_vertices) + 0.5
    height, azimuth = 1.0 - 2.0 * index / max_vertices, np.pi * (1.0 + np.sqrt(5.0)) * index
    level = np.sqrt(1.0 - height**2)
    away = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), height], axis=1)
    vertices = mesh.vertices
    farthest = [int(np.argmax(vertices @ direction)) for direction in away]
    return np.unique(np.round(vertices[farthest], 4), axis=0)


def apparent_size(points: np.ndarray) -> float:
    """Geometric mean side [m] of the box around an outline (n, 3), over random attitudes."""
    rotations = Rotation.from_quat(np.random.default_rng(0).normal(size=(4000, 4))).as_matrix()[:, :2]
    width = np.ptp(np.einsum("nij,vj->niv", rotations, points), axis=2)
    return float(np.exp(np.mean(np.log(width))))
