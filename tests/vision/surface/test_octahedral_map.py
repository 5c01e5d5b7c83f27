"""The octahedral map covers the sphere once, and finds the cell of every direction."""

import numpy as np
from scipy.optimize import nnls

from rpojax.vision.surface import octahedral_map
from tests import surface_meshes

CELLS = 16


def test_every_direction_is_next_to_the_corners_of_its_cell() -> None:
    directions, corners = octahedral_map.cell_directions(CELLS)
    rays = np.random.default_rng(0).normal(size=(5000, 3)) * 7.0
    cells = surface_meshes.cells_of_rays(rays, CELLS)
    assert len(np.unique(cells)) > 0.99 * CELLS**2
    unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    off = np.degrees(np.arccos(np.clip(np.sum(directions[corners[cells]] * unit[:, None], axis=2), -1.0, 1.0)))
    # Cells are 11 deg wide on average, and longest, 29 deg, in the middle of an octant.
    assert off.max() < 29.0
    assert off.mean() < 10.0
    # A direction is inside of its cell: it is a sum of the corners with weights that are not negative.
    for ray, numbers in zip(unit[:200], corners[cells[:200]], strict=True):
        weights, misfit = nnls(directions[numbers[:4]].T, ray)
        assert misfit < 1e-9, weights


def test_corners_and_middles_are_unit_vectors_each_once() -> None:
    directions, corners = octahedral_map.cell_directions(CELLS)
    # Corners are two more than cells, by Euler's formula.
    assert len(directions) == 2 * CELLS**2 + 2
    assert len(np.unique(np.round(directions, 9), axis=0)) == len(directions)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=1e-14)
    assert corners.shape == (CELLS**2, 5)
