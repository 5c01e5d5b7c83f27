"""Surface points and outline of a mesh."""

import numpy as np

from rpojax.training.synthetic_data.meshes import target_mesh


def test_surface_points_lie_on_surface(box: target_mesh.TargetMesh) -> None:
    points, normals = box.surface_points(0.05)
    half = np.array([0.5, 0.3, 0.2])
    np.testing.assert_allclose(np.max(np.abs(points) / half, axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(np.sum(points * normals, axis=1), np.abs(normals) @ half, atol=1e-9)


def test_outline_of_box_is_its_corners(box: target_mesh.TargetMesh) -> None:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.3, 0.3) for z in (-0.2, 0.2)])
    np.testing.assert_allclose(target_mesh.outline_vertices(box), corners, atol=1e-9)
