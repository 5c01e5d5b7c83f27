"""Simplified surfaces: few triangles, a stated error, and nothing done where there is nothing to do."""

import numpy as np

from rpojax.training.synthetic_data.meshes.packaged_target import packaged_target
from rpojax.vision.surface.surface_simplification import simplify
from rpojax.vision.surface.vertex_clustering import clustered


def grid(count: int) -> np.ndarray:
    """Triangles of a plane of a metre, in squares."""
    x, y = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    corner = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 1, 3).astype(float)
    squares = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]])
    return np.concatenate([np.add(corner, square) for square in squares]) / count


def test_few_triangles_stay_as_they_are() -> None:
    found = simplify(grid(5), 50)
    np.testing.assert_array_equal(found.triangles, grid(5))
    assert found.error_m == 0.0


def test_a_plane_stays_a_plane() -> None:
    found, numbers = clustered(grid(40), 300, 0.5)
    assert 100 < len(found) <= 300
    assert len(numbers) == len(found)
    np.testing.assert_allclose(found[:, :, 2], 0.0, atol=1e-12)


def test_the_packaged_target_keeps_its_ranges_within_millimetres() -> None:
    whole = np.concatenate([part.vertices[part.faces] for part in packaged_target().parts])
    found = simplify(whole, 600)
    assert len(whole) > 3000
    assert 400 < len(found.triangles) <= 600
    assert 0.0 < found.error_m < 3e-3
    np.testing.assert_allclose(
        np.ptp(found.triangles.reshape(-1, 3), axis=0), np.ptp(whole.reshape(-1, 3), axis=0), atol=0.03
    )
