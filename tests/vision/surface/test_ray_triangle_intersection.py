"""Nearest hits of rays against trimesh's plane intersections and barycentric coordinates, ray by ray."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from rpojax.training.synthetic_data.meshes.packaged_target import packaged_target
from rpojax.vision.surface.ray_triangle_intersection import NearestHits, nearest_hits

TOLERANCE_M = 1e-6
"""Of ranges, and of the distance from an edge within which rays are left out."""


def surface() -> np.ndarray:
    return np.concatenate([part.vertices[part.faces] for part in packaged_target().parts])


def rays(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A point 5 m to 50 m away, and directions to points of a box that is somewhat larger than the target."""
    rng = np.random.default_rng(seed)
    line = rng.normal(size=3)
    origin = line / np.linalg.norm(line) * rng.uniform(5.0, 50.0)
    directions = rng.uniform([-0.4, -0.9, -0.45], [0.4, 0.9, 0.45], size=(count, 3)) - origin
    return origin, directions / np.linalg.norm(directions, axis=1)[:, None]


def cast(triangles: np.ndarray, origin: np.ndarray, directions: np.ndarray) -> NearestHits:
    return jax.tree.map(np.asarray, jax.jit(nearest_hits)(*map(jnp.asarray, (triangles, origin, directions))))


def by_trimesh(triangles: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> tuple[float, float, bool]:
    """Distance and cosine of incidence of one ray, and whether it passes an edge in front of that too closely."""
    trimesh = pytest.importorskip("trimesh")
    normals, valid = trimesh.triangles.normals(triangles)
    kept = triangles[valid]
    points, crosses, distances = trimesh.intersections.planes_lines(
        kept[:, 0], normals, np.repeat(origin[None], len(kept), 0), np.repeat(direction[None], len(kept), 0), True
    )
    weights = trimesh.triangles.points_to_barycentric(kept[crosses], points)
    sides = np.linalg.norm(kept[crosses][:, [2, 0, 1]] - kept[crosses][:, [1, 2, 0]], axis=2)
    doubled = np.linalg.norm(
        np.cross(kept[crosses][:, 1] - kept[crosses][:, 0], kept[crosses][:, 2] - kept[crosses][:, 0]), axis=1
    )
    inside = np.where((distances > 0.0) & np.all(weights >= 0.0, axis=1), distances, np.inf)
    nearest = float(inside.min())
    from_edges = np.min(weights * (doubled[:, None] / sides), axis=1)
    is_close = (np.abs(from_edges) < TOLERANCE_M) & (distances < nearest + TOLERANCE_M)
    cosine = abs(float(normals[crosses][inside.argmin()] @ direction)) if np.isfinite(nearest) else 0.0
    return nearest, cosine, bool(is_close.any())


@pytest.mark.parametrize("seed", range(4))
def test_ranges_are_those_of_an_independent_ray_caster(seed: int) -> None:
    triangles, (origin, directions) = surface(), rays(100, seed)
    found = cast(triangles, origin, directions)
    expected = [by_trimesh(triangles, origin, each) for each in directions]
    compared = [index for index, (_, _, is_close) in enumerate(expected) if not is_close]
    hits = [index for index in compared if np.isfinite(expected[index][0])]
    assert len(compared) > 95
    assert 20 < len(hits) < 95
    distance, cosine, _ = np.array([expected[index] for index in compared]).T
    np.testing.assert_allclose(found.distance[compared], distance, rtol=0.0, atol=TOLERANCE_M)
    of_hits = np.isfinite(distance)
    # Faces that lie on each other share the distance, not the angle.
    assert np.mean(np.abs(found.cosine[compared] - cosine)[of_hits] < 1e-9) > 0.95
    points = origin + found.distance[hits, None] * directions[hits]
    corners = triangles[found.face[hits]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    heights = np.sum((points - corners[:, 0]) * normals, axis=1) / np.linalg.norm(normals, axis=1)
    np.testing.assert_allclose(heights, 0.0, atol=TOLERANCE_M)


def test_no_ray_slips_between_two_triangles_with_a_common_edge() -> None:
    corners = np.array([[-1.0, -1.0, 0.0], [1.1, -0.9, 0.1], [1.3, 1.0, -0.2], [-0.8, 1.2, 0.3]])
    triangles, origin = corners[[[0, 1, 2], [0, 2, 3]]], np.array([0.1, 0.2, 7.0])
    along = np.linspace(0.01, 0.99, 1000)[:, None] * (corners[2] - corners[0]) + corners[0] - origin
    found = cast(triangles, origin, along / np.linalg.norm(along, axis=1)[:, None])
    np.testing.assert_allclose(found.distance, np.linalg.norm(along, axis=1), rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_no_ray_leaves_a_closed_hull_by_an_edge(seed: int) -> None:
    random = np.random.default_rng(seed)
    points = random.normal(size=(60, 3))
    triangles = points[ConvexHull(points).simplices]
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    share = random.uniform(0.01, 0.99, size=(len(edges), 50, 1))
    origin = 0.1 * random.normal(size=3)
    towards = (share * edges[:, None, 0] + (1.0 - share) * edges[:, None, 1] - origin).reshape(-1, 3)
    found = cast(triangles, origin, towards / np.linalg.norm(towards, axis=1)[:, None])
    np.testing.assert_allclose(found.distance, np.linalg.norm(towards, axis=1), rtol=1e-9)


def test_behind_beside_and_edge_on_there_is_no_hit() -> None:
    triangle = np.array([[[0.0, -1.0, -1.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0]]])
    directions = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert np.isinf(cast(triangle, np.array([2.0, 0.0, 0.0]), directions).distance).all()
    edge_on = cast(triangle, np.array([0.0, 0.0, -3.0]), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    assert np.isinf(edge_on.distance).all()
    assert (edge_on.cosine == 0.0).all()


def test_the_derivative_to_the_point_is_that_of_the_plane() -> None:
    triangle = jnp.array([[[0.0, -1.0, -1.0], [0.1, 1.0, -1.0], [0.2, 0.0, 1.0]]])
    direction = jnp.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    slope = jax.jacrev(lambda origin: nearest_hits(triangle, origin, direction).distance[0])(jnp.array([3.0, 0.0, 0.0]))
    normal = np.cross([0.1, 2.0, 0.0], [0.2, 1.0, 2.0])
    np.testing.assert_allclose(slope, normal / normal[0], atol=1e-12)
