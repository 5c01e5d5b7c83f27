"""Symmetries of a body: proper rotations that map its surface onto itself, found among those that map its corners."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from rpojax.vision.surface.surface_corners import body_size

TOLERANCE: Final = 0.01
"""Distance from the surface, as a share of the body's size, that a symmetry may leave a place of the surface."""
_SAMPLE: Final = 0.003
"""Mean distance of the places that stand for the surface, as a share of the body's size."""
_COMPARED: Final = 4000
"""Most places that are turned and compared with the surface."""
_FEW: Final = 16
"""Corners that are turned first."""
_SAME_TURN: Final = 0.05
"""Angle [rad] between two rotations that are one."""


@dataclass(frozen=True)
class Symmetry:
    """A motion `x -> R x + shift` that maps a body onto itself; `rotation` is R (3, 3), `shift` (3,) [m]."""

    rotation: np.ndarray
    shift: np.ndarray

    def moved(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) [m] after the motion."""
        return points @ self.rotation.T + self.shift


class SampledSurface:
    """A surface as many of its places, by which distances from it are measured to about a third of `TOLERANCE`.

    Attributes:
        size: diagonal of the box around it [m]
        middle: (3,) its middle by area [m]
        places: (n, 3) random places of it [m]
        vertices: (v, 3) [m]
    """

    def __init__(self, triangles: np.ndarray) -> None:
        sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        areas = 0.5 * np.linalg.norm(sides, axis=1)
        self.size = body_size(triangles)
        rng = np.random.default_rng(0)
        count = min(int(areas.sum() / (_SAMPLE * self.size) ** 2) + 1, 400_000)
        chosen = rng.choice(len(triangles), size=count, p=areas / areas.sum())
        self.places = np.einsum("nij,ni->nj", triangles[chosen], rng.dirichlet([1.0, 1.0, 1.0], size=count))
        self._normals = 0.5 * (sides / np.maximum(areas, 1e-300)[:, None])[chosen]
        self.vertices = np.unique(triangles.reshape(-1, 3), axis=0)
        self.middle = (triangles.mean(axis=1) * areas[:, None]).sum(axis=0) / areas.sum()
        self._place_tree = KDTree(self.places)
        self._tree = KDTree(np.concatenate([self.places, self.vertices]))

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distances (n,) [m] of points (n, 3) from the surface."""
        return np.asarray(self._tree.query(points)[0])

    def normals(self, points: np.ndarray) -> np.ndarray:
        """Unit vectors (n, 3) outwards: mean of the surface within twice the tolerance of points (n, 3) on it."""
        near = self._place_tree.query_ball_point(points, 2.0 * TOLERANCE * self.size)
        sums = np.stack([self._normals[each].sum(axis=0) for each in near])
        return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-300)

    def is_mapped_by(self, symmetry: Symmetry) -> bool:
        """Whether a motion leaves the surface where it is."""
        parts = [each[:: max(1, len(each) // _COMPARED)] for each in (self.vertices, self.places)]
        return all(self.distances(symmetry.moved(part)).max() <= TOLERANCE * self.size for part in parts)


def surface_symmetries(surface: SampledSurface, corners: np.ndarray) -> list[Symmetry]:
    """Symmetries of a surface with corners (n, 3) [m], of which that of no turn is the first.

    Only the shape counts: faces of different colours are alike. Corners on one line through the middle tell none.
    """
    offsets = corners - surface.middle
    margin = TOLERANCE * surface.size
    tree = KDTree(offsets)
    few = offsets[:: max(1, len(offsets) // _FEW)]
    found = [Symmetry(np.eye(3), np.zeros(3))]
    for rotation in _candidate_rotations(offsets, margin):
        # Most candidates fail at a few corners already.
        if any(tree.query(each @ rotation.T)[0].max() > margin for each in (few, offsets)):
            continue
        turn = _fitted(offsets, tree, rotation)
        symmetry = Symmetry(turn, surface.middle - turn @ surface.middle)
        if not any(_angle(each.rotation, turn) < _SAME_TURN for each in found) and surface.is_mapped_by(symmetry):
            found.append(symmetry)
    return found


def _candidate_rotations(offsets: np.ndarray, margin: float) -> list[np.ndarray]:
    """Rotations about the origin that take two corners to two others, in the same distances from it and each other."""
    lengths = np.linalg.norm(offsets, axis=1)
    first = int(np.argmax(lengths))
    second = int(np.argmax(np.linalg.norm(np.cross(offsets[first], offsets), axis=1)))
    distance = np.linalg.norm(offsets[first] - offsets[second])
    if np.linalg.norm(np.cross(offsets[first], offsets[second])) < (2.0 * margin) ** 2:
        return []
    own = _triad(offsets[first], offsets[second])
    rotations = []
    for other in np.flatnonzero(np.abs(lengths - lengths[first]) <= 2.0 * margin):
        apart = np.linalg.norm(offsets - offsets[other], axis=1)
        alike = (np.abs(lengths - lengths[second]) <= 2.0 * margin) & (np.abs(apart - distance) <= 2.0 * margin)
        rotations += [_triad(offsets[other], offsets[each]) @ own.T for each in np.flatnonzero(alike)]
    return rotations


def _triad(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Columns of a frame whose first axis is along `a`, with `b` in the plane of the first two."""
    x = a / np.linalg.norm(a)
    z = np.cross(a, b)
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _fitted(offsets: np.ndarray, tree: KDTree, rotation: np.ndarray) -> np.ndarray:
    """Rotation near `rotation` that fits all corners best."""
    matched = offsets[tree.query(offsets @ rotation.T)[1]]
    return Rotation.align_vectors(matched, offsets)[0].as_matrix()


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(Rotation.from_matrix(a.T @ b).magnitude())
