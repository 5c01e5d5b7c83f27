"""Facets of about equal area of a surface of triangles, without what lies inside the body."""

from dataclasses import dataclass, fields

import numpy as np

from rpojax.vision.surface import octahedral_map
from rpojax.vision.surface.ray_casting import free_directions

_PIECES_PER_FACET = 4
_OPENNESS_CELLS = 8
"""Cells along a side of the grid of directions by which pieces inside of the body are recognised."""


@dataclass(frozen=True)
class Facets:
    """Facets of a surface in T, and the pieces of triangles that they consist of.

    Attributes:
        centers: (facets, 3) middle of the piece in the middle of each [m]
        normals: (facets, 3) its unit vector outwards
        areas: (facets,) [m^2]
        pieces: (pieces, 3, 3) corners of the pieces [m], for drawing
        piece_facets: (pieces,) facet of each piece
    """

    centers: np.ndarray
    normals: np.ndarray
    areas: np.ndarray
    pieces: np.ndarray
    piece_facets: np.ndarray

    def arrays(self) -> dict[str, np.ndarray]:
        """All attributes by name, as they are stored."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def make_facets(triangles: np.ndarray, size_m: float) -> Facets:
    """Facets of a surface of triangles (triangles, 3, 3) [m], counter-clockwise from outside.

    Triangles are cut into pieces; pieces from which no direction is free lie inside of the body and are left out. The
    others make one facet where they lie in the same cube of side `size_m` and face along the same axis.
    """
    pieces = _cut(triangles, size_m * size_m / _PIECES_PER_FACET)
    doubled = np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])
    areas = 0.5 * np.linalg.norm(doubled, axis=1)
    pieces, areas, normals = (
        each[areas > 0.0] for each in (pieces, areas, doubled / np.maximum(2 * areas, 1e-300)[:, None])
    )
    middles = pieces.mean(axis=1)
    directions, _ = octahedral_map.corner_directions(_OPENNESS_CELLS)
    outside = free_directions(middles, normals, triangles, directions).any(axis=1)
    pieces, areas, normals, middles = (each[outside] for each in (pieces, areas, normals, middles))
    numbers = _cluster(middles, normals, size_m)
    total = np.bincount(numbers, weights=areas)
    weighted = [np.bincount(numbers, weights=areas * column) / total for column in middles.T]
    # The piece next to the mean place stands for its facet, so that the centre lies on the surface.
    offsets = np.linalg.norm(middles - np.stack(weighted, axis=1)[numbers], axis=1)
    order = np.lexsort((offsets, numbers))
    nearest = order[np.searchsorted(numbers[order], np.arange(len(total)))]
    return Facets(middles[nearest], normals[nearest], total, pieces, numbers)


def _cut(triangles: np.ndarray, most_area: float) -> np.ndarray:
    """Triangles (n, 3, 3) halved at their longest side until none is larger than `most_area` [m^2]."""
    finished, rest = [], triangles
    while len(rest):
        area = 0.5 * np.linalg.norm(np.cross(rest[:, 1] - rest[:, 0], rest[:, 2] - rest[:, 0]), axis=1)
        finished.append(rest[area <= most_area])
        rest = rest[area > most_area]
        sides = np.linalg.norm(rest[:, [1, 2, 0]] - rest, axis=2)
        longest = np.argmax(sides, axis=1)
        a, b, c = (rest[np.arange(len(rest)), (longest + step) % 3] for step in range(3))
        middle = 0.5 * (a + b)
        rest = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(finished)


def _cluster(middles: np.ndarray, normals: np.ndarray, size_m: float) -> np.ndarray:
    """Number of the facet of each piece: by cube, and by axis and sign of the largest component of its normal."""
    low, high = middles.min(axis=0), middles.max(axis=0)
    count = np.maximum(np.ceil((high - low) / size_m), 1.0)
    # Cubes fill the box around the pieces evenly; faces of the box lie inside of the outer cubes.
    cube = np.floor((middles - 0.5 * (low + high)) / ((high - low) * (1.0 + 1e-6) / count + 1e-12) + 0.5 * count)
    axis = np.argmax(np.abs(np.round(normals, 6)), axis=1)
    side = np.sign(normals[np.arange(len(normals)), axis])
    key = np.column_stack([cube, axis, side]).astype(np.int64)
    return np.unique(key, axis=0, return_inverse=True)[1].reshape(-1)
