"""Landmarks of bodies whose corners and symmetries are known, their visibility against ray casting, and their file."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core import quaternion
from rpojax.scenario.loading import scenario_loader
from rpojax.training.synthetic_data.meshes import packaged_target
from rpojax.vision.surface.landmark_file import load_landmarks, save_landmarks
from rpojax.vision.surface.landmark_selection import SPACING, landmarks_at, select_landmarks
from rpojax.vision.surface.landmarks import LandmarkError, Landmarks, are_free
from rpojax.vision.surface.port_view import PortView
from rpojax.vision.surface.surface_corners import body_size, corners
from rpojax.vision.weight_files import WeightsError, read_tensors, write_tensors
from tests import surface_meshes

BOX_CORNERS = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)])


def l_shaped() -> np.ndarray:
    """A flat box with a tower at one end of it."""
    return np.concatenate(
        [
            surface_meshes.box((0.0, 0.0, 0.0), (2.0, 1.0, 0.4)),
            surface_meshes.box((-0.7, 0.1, 0.7), (0.4, 0.6, 1.4)),
        ]
    )


@pytest.fixture(scope="module")
def target() -> np.ndarray:
    """Triangles of the packaged target."""
    return np.concatenate([part.vertices[part.faces] for part in packaged_target.packaged_target().parts])


@pytest.fixture(scope="module")
def packaged() -> Landmarks:
    """Landmarks that come with the package."""
    return load_landmarks()[0]


def visible(landmarks: Landmarks, direction: np.ndarray) -> np.ndarray:
    """Whether each landmark is free towards one direction."""
    return np.asarray(are_free(landmarks.visible, np.broadcast_to(direction, landmarks.positions.shape)))


def test_the_landmarks_of_a_cube_are_its_corners_with_all_its_rotations() -> None:
    found = select_landmarks(surface_meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), 12)
    order = np.lexsort(np.asarray(found.positions).T[::-1])
    np.testing.assert_allclose(found.positions[order], BOX_CORNERS, atol=1e-12)
    np.testing.assert_allclose(found.normals[order], BOX_CORNERS * 2.0 / np.sqrt(3.0), atol=1e-12)
    assert len(found.symmetries) == 24
    # From a direction in the open octant of a corner the opposite corner alone is hidden.
    assert visible(found, np.array([1.0, 0.8, 0.9])).sum() == 7


def test_corners_do_not_depend_on_how_the_surface_is_cut_into_triangles() -> None:
    box = surface_meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    pieces = box
    # Each triangle is halved at its longest side by itself, so that vertices end in the middle of others' sides.
    for number in range(6):
        chosen = np.arange(len(pieces)) % 3 != number % 3
        a, b, c = np.moveaxis(pieces[chosen], 1, 0)
        middle = 0.5 * (b + c)
        halves = [np.stack([a, b, middle], axis=1), np.stack([a, middle, c], axis=1)]
        pieces = np.roll(np.concatenate([pieces[~chosen], *halves]), 1, axis=1)
    assert len(pieces) > 150
    found = corners(pieces).positions
    np.testing.assert_allclose(found[np.lexsort(found.T[::-1])], BOX_CORNERS, atol=1e-12)


def test_a_plate_has_its_corners_alone() -> None:
    side = surface_meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    plate = side[np.all(side[:, :, 0] > 0.0, axis=1)]
    assert len(corners(plate).positions) == 4


@pytest.mark.parametrize(
    ("size", "shift", "turns"), [((2.0, 1.0, 1.0), (0.0, 0.0, 0.0), 8), ((2.0, 1.0, 0.6), (0.1, 0.05, 0.0), 4)]
)
def test_symmetries_exchange_landmarks_by_their_permutations(
    size: tuple[float, float, float], shift: tuple[float, float, float], turns: int
) -> None:
    found = select_landmarks(surface_meshes.box(shift, size))
    assert len(found.symmetries) == turns
    np.testing.assert_array_equal(found.permutations[0], np.arange(8))
    np.testing.assert_allclose(found.symmetries[0], [1.0, 0.0, 0.0, 0.0], atol=1e-12)
    for q, move, permutation in zip(found.symmetries, found.shifts, np.asarray(found.permutations), strict=True):
        moved = np.asarray(found.positions) @ np.asarray(quaternion.to_matrix(q)).T + np.asarray(move)
        np.testing.assert_allclose(moved, np.asarray(found.positions)[permutation], atol=1e-9)
        assert np.array_equal(np.sort(permutation), np.arange(8))


def test_bodies_without_symmetry_have_none(packaged: Landmarks) -> None:
    assert len(select_landmarks(l_shaped()).symmetries) == 1
    assert len(packaged.symmetries) == 1


def test_what_lies_inside_of_the_body_is_no_landmark() -> None:
    found = np.asarray(select_landmarks(l_shaped()).positions)
    # The foot of the tower is inside of the box, and not where its sides leave it.
    assert len(found) == 12
    assert np.all((found[:, 2] > 0.19) | (found[:, 2] < -0.19))


def test_landmarks_are_on_edges_apart_and_as_many_as_asked(target: np.ndarray, packaged: Landmarks) -> None:
    places = np.asarray(packaged.positions)
    known = corners(target).positions
    assert np.linalg.norm(places[:, None] - known[None], axis=2).min(axis=1).max() < 1e-9
    distances = np.linalg.norm(places[:, None] - places[None], axis=2) + 9.0 * np.eye(len(places))
    assert distances.min() >= SPACING * body_size(target)
    assert len(places) == 20
    np.testing.assert_allclose(np.linalg.norm(packaged.normals, axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("body", ["l_shaped", "target"])
def test_what_is_called_visible_is_so_by_direct_ray_casting(body: str, target: np.ndarray, packaged: Landmarks) -> None:
    triangles = l_shaped() if body == "l_shaped" else target
    found = select_landmarks(triangles) if body == "l_shaped" else packaged
    starts = np.asarray(found.positions) + 1e-4 * body_size(triangles) * np.asarray(found.normals)
    rays = np.random.default_rng(6).normal(size=(60, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    called = np.array([visible(found, ray) for ray in rays])
    truth = np.array([[not surface_meshes.meets(start, ray, triangles) for start in starts] for ray in rays])
    # A part thinner than a cell of the table may slip through it.
    assert np.sum(called & ~truth) <= 0.005 * called.size
    assert np.sum(truth & ~called) <= 0.08 * truth.sum()


def test_the_packaged_landmarks_are_seen_from_all_round_and_on_the_port(packaged: Landmarks) -> None:
    lens = scenario_loader.load("final_approach").model_dump()["wide_lens"]["field_of_view_deg"]
    assert lens == 45.0
    rays = np.random.default_rng(9).normal(size=(300, 3))
    counts = np.array([visible(packaged, ray).sum() for ray in rays])
    assert counts.min() >= 8
    view = PortView(np.array(packaged_target.PORT_POSITION), np.array(packaged_target.PORT_AXIS))
    assert np.linalg.norm(view.camera()) == pytest.approx(1.5, abs=1e-12)
    places = (np.asarray(each) for each in (packaged.positions, packaged.normals, packaged.visible))
    assert view.on_face(*places).sum() >= 8
    assert packaged.port_position is not None
    np.testing.assert_allclose(packaged.port_position, packaged_target.PORT_POSITION)


def test_landmarks_on_the_port_are_in_front_of_the_lens_and_face_it(target: np.ndarray) -> None:
    view = PortView(np.array([-0.247, 0.0, 0.06]), np.array([-2.0, 0.0, 0.0]), fewest=6)
    found = select_landmarks(target, 14, view)
    on_face = view.on_face(np.asarray(found.positions), np.asarray(found.normals), np.asarray(found.visible))
    places = np.asarray(found.positions)[on_face]
    assert on_face.sum() >= 6
    lines = places - view.camera()
    assert np.all(np.degrees(np.arccos(-lines[:, 0] * -1.0 / np.linalg.norm(lines, axis=1))) < 22.5)
    assert np.all(np.sum(lines * np.asarray(found.normals)[on_face], axis=1) < 0.0)
    assert len(found.positions) == 14


def test_more_landmarks_tell_more_from_where_least_is_told(packaged: Landmarks, target: np.ndarray) -> None:
    # The same number of corners in the order of the mesh is seen worse from the worst directions.
    rays = np.random.default_rng(1).normal(size=(200, 3))
    any_corners = landmarks_at(corners(target).positions[[0, 1, 2, 3, 4, 5, 6, 7]], target)
    chosen = select_landmarks(target, 8)
    counts = [np.sort([visible(each, ray).sum() for ray in rays])[:50].mean() for each in (chosen, any_corners)]
    assert counts[0] >= counts[1]


@pytest.mark.parametrize(
    ("triangles", "arguments", "expected"),
    [
        (surface_meshes.sphere(0.7), {}, "smooth body"),
        (surface_meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), {"count": 5}, "count: found 5"),
        (surface_meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), {"count": 7}, "at least 8, corners that symmetries"),
    ],
)
def test_bodies_without_landmarks_are_refused(triangles: np.ndarray, arguments: dict[str, int], expected: str) -> None:
    with pytest.raises(LandmarkError, match=expected):
        select_landmarks(triangles, **arguments)


@pytest.mark.parametrize(
    ("position", "axis", "expected"),
    [
        ((0.0, 0.0, 0.2), (0.0, 0.0, 1.0), "from the surface"),
        ((0.0, 0.0, 0.5), (0.0, 0.0, -1.0), "meets the body"),
        ((0.0, 0.0, 0.5), (0.0, 0.0, 0.0), "place and a direction"),
        ((0.0, 0.0, 0.5), (0.0, 0.0, 1.0), "found 4 corners"),
    ],
)
def test_ports_that_do_not_fit_are_refused(position: tuple[float, ...], axis: tuple[float, ...], expected: str) -> None:
    cube = surface_meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    with pytest.raises(LandmarkError, match=expected):
        select_landmarks(cube, 12, PortView(np.array(position), np.array(axis), range_m=3.0))


def test_given_places_have_to_be_on_the_surface_and_outside() -> None:
    body = l_shaped()
    known = np.asarray(select_landmarks(body).positions)
    found = landmarks_at(known, body)
    assert len(found.symmetries) == 1
    with pytest.raises(LandmarkError, match=r"landmark 2 at 0\.3 m from the surface"):
        landmarks_at(np.vstack([known[:2], [[0.5, 0.0, 0.5]], known[3:]]), body)
    with pytest.raises(LandmarkError, match="landmark 12 inside of the body"):
        # A corner of the tower's foot, within the box.
        landmarks_at(np.vstack([known, [[-0.5, 0.1, 0.0]]]), body)


def test_a_file_holds_what_was_saved(packaged: Landmarks, tmp_path: Path) -> None:
    save_landmarks(packaged, tmp_path / "a.landmarks", {"mesh": "target"})
    again, card = load_landmarks(tmp_path / "a.landmarks")
    assert card == {"mesh": "target"}
    assert jax.tree.structure(again) == jax.tree.structure(packaged)
    assert all(jnp.array_equal(a, b) for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(packaged), strict=True))


@pytest.mark.parametrize(
    ("name", "change", "expected"),
    [
        ("visible", lambda each: each & (np.arange(20) != 3), r"inside of the body \(3\)"),
        ("normals", lambda each: 2.0 * each, "normals: found a vector"),
        ("permutations", lambda each: each * 0, "permutations: found a row"),
        ("permutations", lambda each: each[:, ::-1], "a first row"),
        ("positions", lambda each: each * np.nan, "not finite"),
        ("port_axis", lambda each: 0.5 * each, "port_axis: found a vector"),
    ],
)
def test_a_file_with_impossible_landmarks_is_refused(name: str, change: object, expected: str, tmp_path: Path) -> None:
    save_landmarks(load_landmarks()[0], tmp_path / "a.landmarks", {})
    tensors, metadata = read_tensors(tmp_path / "a.landmarks")
    assert callable(change)
    write_tensors(tmp_path / "a.landmarks", {**tensors, name: change(tensors[name])}, metadata)
    with pytest.raises(WeightsError, match=expected):
        load_landmarks(tmp_path / "a.landmarks")
