"""Table of the directions from which the facets of a surface can be seen past the rest of it."""

import numpy as np

from rpojax.vision.surface import octahedral_map
from rpojax.vision.surface.facets import Facets
from rpojax.vision.surface.ray_casting import free_directions

CELLS = 32
"""Cells along a side of the octahedral grid of directions, some 6 deg wide."""


def visibility_table(facets: Facets, triangles: np.ndarray) -> np.ndarray:
    """Whether each facet is seen past the surface from the directions of each cell (cells^2, facets).

    A facet is hidden in a cell if the surface hides it in a corner or the middle of the cell, above the facet's
    horizon, so that what the table calls visible is visible. The horizon itself is left to the incidence. The surface
    is that of `triangles` (triangles, 3, 3) [m].
    """
    directions, of_cells = octahedral_map.cell_directions(CELLS)
    free = free_directions(facets.centers, facets.normals, triangles, directions)
    # On the horizon itself rounding decides which rays are free.
    above = np.asarray(directions @ facets.normals.T > 1e-4)
    hidden = above & ~free.T
    return np.asarray(above[of_cells].any(axis=1) & ~hidden[of_cells].any(axis=1))
