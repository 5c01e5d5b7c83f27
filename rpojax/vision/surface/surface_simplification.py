"""Surface of few triangles for ranges in the loop, and by how much its ranges differ from those of the whole one."""

from dataclasses import dataclass
from typing import Final

import jax
import numpy as np

from rpojax.vision.surface.ray_triangle_intersection import nearest_hits
from rpojax.vision.surface.vertex_clustering import clustered

_POINTS: Final = 128
_RAYS: Final = 512
"""Rays from each point. Of the packaged target three percent of the visible triangles are met by none of all."""
_DISTANCE: Final = 10.0
"""Distance of the points over the radius of the surface."""
_LEAST_HITS: Final = 3
"""Hits of a triangle that is seen: one that is met less often is smaller than the spacing of a LiDAR's rays."""
_SHIFTS: Final = (0.2, 0.35, 0.5, 0.65, 0.8)
"""Places of the grid that are tried: it decides which of two near edges become one."""
_LARGEST: Final = 0.1
"""Difference over the radius that counts for a ray which meets one of the two surfaces only, and at most."""


@dataclass(frozen=True)
class SimplifiedSurface:
    """Few triangles that stand for many.

    Attributes:
        triangles: (n, 3, 3) [m]
        numbers: (n,) of the triangle that each was
        error_m: mean difference of the ranges from those of the whole surface
    """

    triangles: np.ndarray
    numbers: np.ndarray
    error_m: float


def simplify(triangles: np.ndarray, most: int) -> SimplifiedSurface:
    """At most `most` triangles like those given (m, 3, 3) [m]: as they are, or by the clustering with the least error.

    Triangles that are not seen from outside are left out first.
    """
    if len(triangles) <= most:
        return SimplifiedSurface(triangles, np.arange(len(triangles)), 0.0)
    radius = float(np.linalg.norm(triangles.reshape(-1, 3), axis=1).max())
    origins, directions = _rays(triangles, radius)
    distances, faces = _cast(triangles, origins, directions)
    hits = np.bincount(faces[np.isfinite(distances)], minlength=len(triangles))
    seen = np.flatnonzero(hits >= _LEAST_HITS)
    best: SimplifiedSurface | None = None
    for shift in _SHIFTS:
        found, numbers = clustered(triangles[seen], most, shift)
        padded = np.concatenate([found, np.zeros((most - len(found), 3, 3))])
        ranges, _ = _cast(padded, origins[::8], directions[::8])
        errors = _differences(ranges, distances[::8], _LARGEST * radius)
        if best is None or errors.mean() < best.error_m:
            best = SimplifiedSurface(found, seen[numbers], float(errors.mean()))
    assert best is not None
    return best


def _rays(triangles: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (points, 3) around a surface, and unit vectors (points, rays, 3) from each to places on the surface."""
    rng = np.random.default_rng(0)
    lines = rng.normal(size=(_POINTS, 3))
    origins = _DISTANCE * radius * lines / np.linalg.norm(lines, axis=1)[:, None]
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(sides, axis=1)
    # Mostly by area, as rays meet them, and by number, so that small triangles are met, too.
    share = 0.8 * areas / areas.sum() + 0.2 / len(triangles)
    chosen = triangles[rng.choice(len(triangles), size=(_POINTS, _RAYS), p=share)]
    places = np.einsum("prij,pri->prj", chosen, rng.dirichlet([1.0, 1.0, 1.0], size=(_POINTS, _RAYS)))
    lines = places - origins[:, None]
    return origins, lines / np.linalg.norm(lines, axis=2)[:, :, None]


_hits = jax.jit(nearest_hits)


def _cast(triangles: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    found = [_hits(triangles, origin, rays) for origin, rays in zip(origins, directions, strict=True)]
    return np.stack([each.distance for each in found]), np.stack([each.face for each in found])


def _differences(ranges: np.ndarray, expected: np.ndarray, largest: float) -> np.ndarray:
    """Differences of ranges of the rays that meet a surface."""
    both = np.isfinite(ranges) & np.isfinite(expected)
    one = np.isfinite(ranges) != np.isfinite(expected)
    differences = np.abs(np.where(both, ranges, 0.0) - np.where(both, expected, 0.0))
    return np.minimum(np.where(one, largest, differences), largest)[both | one]
