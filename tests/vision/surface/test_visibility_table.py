"""Facets and their visibility against geometry known by hand, and against independent ray casting."""

import numpy as np
import pytest

from rpojax.vision.surface import ray_casting
from rpojax.vision.surface.facets import Facets, make_facets
from rpojax.vision.surface.visibility_table import CELLS, visibility_table
from tests import surface_meshes


@pytest.fixture(scope="module")
def l_shape() -> tuple[np.ndarray, Facets, np.ndarray]:
    """A flat box with a tower next to its -x end, the tower's foot inside of the box; triangles, facets and table."""
    triangles = np.concatenate(
        [
            surface_meshes.box((0.0, 0.0, 0.0), (2.0, 1.0, 0.4)),
            surface_meshes.box((-0.75, 0.0, 0.7), (0.4, 0.9, 1.4)),
        ]
    )
    facets = make_facets(triangles, 0.2)
    return triangles, facets, visibility_table(facets, triangles)


def is_visible(table: np.ndarray, direction: tuple[float, float, float]) -> np.ndarray:
    return table[surface_meshes.cells_of_rays(np.array([direction]), CELLS)[0]]


def test_what_lies_inside_of_the_body_is_no_facet(l_shape: tuple[np.ndarray, Facets, np.ndarray]) -> None:
    _, facets, _ = l_shape
    # Outer surface: box 2 (2 + 0.4) + 2 0.8, less the footprint 0.36 of the tower; tower above it 1.2 high.
    expected = 2.0 * (2.0 + 0.8 + 0.4) - 0.36 + 0.36 + 1.2 * 2.0 * (0.4 + 0.9)
    # To the pieces that the border of the footprint cuts.
    assert facets.areas.sum() == pytest.approx(expected, rel=0.03)
    x, y, z = facets.centers.T
    inside_box = (np.abs(x) < 0.99) & (np.abs(y) < 0.49) & (np.abs(z) < 0.19)
    inside_tower = (np.abs(x + 0.75) < 0.19) & (np.abs(y) < 0.44) & (z > 0.0) & (z < 1.39)
    assert not np.any(inside_box | inside_tower)
    assert np.median(facets.areas) == pytest.approx(0.04, rel=0.2)


def test_facets_face_outwards_and_keep_the_area_of_a_box() -> None:
    facets = make_facets(surface_meshes.box((0.1, 0.2, 0.3), (1.0, 0.5, 0.8)), 0.1)
    assert facets.areas.sum() == pytest.approx(2.0 * (0.5 + 0.4 + 0.8), rel=1e-12)
    np.testing.assert_allclose(np.linalg.norm(facets.normals, axis=1), 1.0, rtol=1e-12)
    assert np.all(np.sum(facets.normals * (facets.centers - [0.1, 0.2, 0.3]), axis=1) > 0.2)
    np.testing.assert_allclose(np.abs(facets.normals).max(axis=1), 1.0, rtol=1e-12)


def test_a_convex_body_hides_nothing_above_the_horizon() -> None:
    rays = np.random.default_rng(3).normal(size=(500, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    cells = surface_meshes.cells_of_rays(rays, CELLS)
    for body in (surface_meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), surface_meshes.sphere(0.7)):
        facets = make_facets(body, 0.25)
        # Of a cell next to the horizon a sliver may be above it, and none of its five directions.
        above = rays @ facets.normals.T > 0.03
        assert np.all(visibility_table(facets, body)[cells][above])


def test_the_tower_hides_the_deck_behind_it(l_shape: tuple[np.ndarray, Facets, np.ndarray]) -> None:
    _, facets, table = l_shape
    x, y, _ = facets.centers.T
    deck = (facets.normals[:, 2] > 0.99) & (np.abs(facets.centers[:, 2] - 0.2) < 0.01)
    middle = deck & (np.abs(y) < 0.3) & (x > -0.5)
    assert middle.sum() > 10
    # The tower ends at x = -0.55, 1.2 above the deck: at an elevation of 45 deg its shadow reaches to x = 0.65.
    # Cells are some 6 deg wide.
    from_behind = is_visible(table, (-1.0, 0.0, 1.0))
    assert not np.any(from_behind[middle & (x < 0.35)])
    assert np.all(from_behind[middle & (x > 0.95)])
    # At 70 deg it reaches 0.44, to x = -0.11.
    steep = is_visible(table, (-np.cos(np.radians(70.0)), 0.0, np.sin(np.radians(70.0))))
    assert not np.any(steep[middle & (x < -0.45)])
    assert np.all(steep[middle & (x > 0.15)])
    # From the other side nothing hides the deck.
    assert np.all(is_visible(table, (1.0, 0.1, 1.0))[middle])
    assert not np.any(is_visible(table, (0.3, 0.1, -1.0))[deck])


def test_rays_agree_with_independent_ray_casting(l_shape: tuple[np.ndarray, Facets, np.ndarray]) -> None:
    triangles, facets, _ = l_shape
    rng = np.random.default_rng(5)
    rays = rng.normal(size=(30, 3))
    rays = np.concatenate([rays, -rays]) / np.tile(np.linalg.norm(rays, axis=1, keepdims=True), (2, 1))
    chosen = rng.choice(len(facets.areas), 80, replace=False)
    found = ray_casting.free_directions(facets.centers[chosen], facets.normals[chosen], triangles, rays)
    starts = facets.centers + 1e-4 * facets.normals
    expected = [
        [ray @ facets.normals[row] > 0.0 and not surface_meshes.meets(starts[row], ray, triangles) for ray in rays]
        for row in chosen
    ]
    np.testing.assert_array_equal(found, expected)
    assert 0.2 < found.mean() < 0.5


def test_what_the_table_calls_visible_is_not_behind_another_part(
    l_shape: tuple[np.ndarray, Facets, np.ndarray],
) -> None:
    triangles, facets, table = l_shape
    rng = np.random.default_rng(6)
    rays = rng.normal(size=(400, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    visible = table[surface_meshes.cells_of_rays(rays, CELLS)] & (rays @ facets.normals.T > 0.0)
    pairs = rng.permutation(np.argwhere(visible))[:4000]
    wrong = sum(
        surface_meshes.meets(facets.centers[row] + 1e-6 * facets.normals[row], rays[ray], triangles)
        for ray, row in pairs
    )
    assert wrong <= 4  # 99.9 %
    # And little else is hidden: cells at the edge of a shadow only.
    above = rays @ facets.normals.T > 0.0
    hidden = rng.permutation(np.argwhere(above & ~visible))[:1000]
    free = [
        not surface_meshes.meets(facets.centers[row] + 1e-6 * facets.normals[row], rays[ray], triangles)
        for ray, row in hidden
    ]
    assert np.sum(free) / len(free) * np.mean(above & ~visible) < 0.05 * np.mean(above)


def test_no_ray_slips_through_the_edge_between_two_triangles() -> None:
    # Diagonals and edges of a closed box from its centre, exactly towards its corners and middles of edges.
    triangles = surface_meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    towards = np.array(
        [[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if (i, j, k) != (0, 0, 0)]
    )
    rays = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    start = np.zeros((2, 3))
    normals = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    assert not np.any(ray_casting.free_directions(start, normals, triangles, rays))
