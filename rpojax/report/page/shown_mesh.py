"""Mesh of the target as pages draw it: that of its surface, its hull or a box, with few enough triangles to paint."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from rpojax.errors import RpojaxError

MAX_TRIANGLES: Final = 1500
"""Most triangles of a page; a canvas paints them in a few milliseconds."""
_ANY_FACET_SIZE_M: Final = 1e3
_BOX_FACES: Final = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
"""Corners of each face, counter-clockwise from outside; bits of a corner's number are the ends in z, y and x."""


def shown_mesh(scenario: Mapping[str, Any], scale: float = 1.0) -> dict[str, Any] | None:
    """Corners and triangles of the target in its body axes [m]; None if the scenario has no outline of it.

    The surface whose coverage is judged comes first, then the hull, then a box of the hull's size; `scale` is that of
    the true target.
    """
    triangles = _surface(scenario)
    if triangles is None:
        return None
    corners, numbers = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    corners, numbers = simplified(corners, np.asarray(numbers).reshape(-1, 3), MAX_TRIANGLES)
    return {"corners": (scale * corners).round(4).ravel().tolist(), "triangles": numbers.ravel().tolist()}


def simplified(corners: np.ndarray, triangles: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n, 3) and triangles (m, 3) with at most `most` of them, by merging corners in cells of a grid.

    The cells are as small as that allows; a merged corner lies at the mean of those in its cell.
    """
    cells = 256
    found = corners, triangles
    while len(found[1]) > most:
        found = _merged(corners, triangles, cells)
        cells = cells * 7 // 8
    return found


def _merged(corners: np.ndarray, triangles: np.ndarray, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Mesh with the corners of each cell merged, of `cells` along the longest side, without collapsed triangles."""
    low = corners.min(axis=0)
    size = float(np.max(corners.max(axis=0) - low)) / cells
    _, cell = np.unique(np.floor((corners - low) / size).astype(np.int64), axis=0, return_inverse=True)
    cell = np.asarray(cell).ravel()
    counts = np.bincount(cell)
    means = np.stack([np.bincount(cell, weights=corners[:, axis]) / counts for axis in range(3)], axis=1)
    numbers = cell[triangles]
    distinct = (numbers != np.roll(numbers, 1, axis=1)).all(axis=1)
    numbers = numbers[distinct]
    first = np.argmin(numbers, axis=1)[:, None]
    turned = np.take_along_axis(numbers, (first + np.arange(3)) % 3, axis=1)
    return means, np.unique(turned, axis=0)


def _surface(scenario: Mapping[str, Any]) -> np.ndarray | None:
    """Triangles (n, 3, 3) [m] of the surface, hull or box; None without an outline."""
    # Imported here because meshes need packages that other pages do without.
    from rpojax.scenario.trained.coverage_surface import HULL, surface_triangles

    # The size of facets matters to coverage alone; a large one is never refused.
    coverage = {"surface": HULL, **scenario.get("coverage", {}), "facet_size_m": _ANY_FACET_SIZE_M}
    for surface in dict.fromkeys((coverage["surface"], HULL)):
        try:
            return surface_triangles({**scenario, "coverage": {**coverage, "surface": surface}})
        except (RpojaxError, KeyError):
            continue
    points = np.asarray(scenario.get("target", {}).get("hull_m", ()), dtype=np.float64)
    return box_triangles(points.min(axis=0), points.max(axis=0)) if points.size else None


def box_triangles(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Triangles (12, 3, 3) of the box between two opposite corners, counter-clockwise from outside."""
    ends = np.array([low, high], dtype=np.float64)
    corners = np.array([[ends[number & 1, 0], ends[number >> 1 & 1, 1], ends[number >> 2, 2]] for number in range(8)])
    return np.array([corners[list(part)] for a, b, c, d in _BOX_FACES for part in ((a, b, c), (a, c, d))])
