"""Geometric camera: boxes worked by hand, conditions for a box, and statistics of its errors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.pytree import replace
from rpojax.scenario.params import Params
from rpojax.sensors import geometric_camera
from rpojax.sensors.camera import Camera, CameraFrame

SIZE = 128
FOCAL = 64.0  # of a 90 deg lens on 128 px
FRAMES = 20_000
FOUR_SIGMA = 4.0  # one false alarm in 16000, and the seeds are fixed
EXACT = 1e-12  # roundings of pixels
CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
NO_NORMALS = np.zeros(4)
SEEN = np.array([0.5, 0.9, 0.5, 0.5, 0.5, 0.5])
"""Uniform numbers of a frame that is neither missed nor false."""
measure = jax.jit(geometric_camera.measure, static_argnums=(1, 2))
measure_many = jax.jit(
    jax.vmap(geometric_camera.measure, in_axes=(None, None, None, None, None, None, 0, 0)), static_argnums=(1, 2)
)
YES, NO = jnp.asarray(True), jnp.asarray(False)


@pytest.fixture(scope="module")
def wide(params: Params) -> Camera:
    """The nominal camera with a 90 deg lens."""
    return replace(params.camera, field_of_view=jnp.float64(np.pi / 2))


def cube(x: float, y: float, z: float, scale: float = 1.0) -> np.ndarray:
    """Corners of a cube with sides of two metres about a place in camera axes."""
    return scale * CUBE + np.array([x, y, z])


def expose(
    camera: Camera,
    hull: np.ndarray,
    normals: np.ndarray = NO_NORMALS,
    observable: jax.Array = YES,
    working: jax.Array = YES,
) -> CameraFrame:
    return measure(camera, SIZE, SIZE, hull, observable, working, normals, SEEN)


def many(
    camera: Camera,
    hull: np.ndarray,
    observable: jax.Array = YES,
    size: int = SIZE,
    seed: int = 0,
    working: jax.Array = YES,
) -> CameraFrame:
    rng = np.random.default_rng(seed)
    normals, uniforms = rng.normal(size=(FRAMES, 4)), rng.uniform(size=(FRAMES, 6))
    return jax.tree.map(np.asarray, measure_many(camera, size, size, hull, observable, working, normals, uniforms))


def assert_share(found: float, expected: float, of: int = FRAMES) -> None:
    assert abs(found - expected) < FOUR_SIGMA * np.sqrt(expected * (1.0 - expected) / of)


def test_a_cube_straight_ahead_has_the_box_of_its_near_face(wide: Camera) -> None:
    frame = expose(wide, cube(0.0, 0.0, 9.0))
    half = FOCAL / 8.0
    np.testing.assert_allclose(frame.box.edges, [64 - half, 64 - half, 64 + half, 64 + half], atol=EXACT)
    assert frame.box.present
    assert not frame.box.truncated
    assert not frame.outlier


def test_a_target_to_the_right_and_below_has_a_box_to_the_right_and_below(wide: Camera) -> None:
    left, top, right, bottom = expose(wide, cube(3.0, 5.0, 10.0, scale=0.1)).box.edges
    np.testing.assert_allclose([(left + right) / 2, (top + bottom) / 2], [64 + 19.2, 64 + 32.0], atol=0.1)


def test_each_edge_has_noise_of_its_own(wide: Camera) -> None:
    hull = cube(0.0, 0.0, 9.0)
    moved = expose(wide, hull, normals=np.array([1.0, -2.0, 0.5, 0.0])).box.edges - expose(wide, hull).box.edges
    np.testing.assert_allclose(moved, [1.0, -2.0, 0.5, 0.0], atol=EXACT)


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ([0.0, 0.0, -9.0], "behind the camera"),
        ([0.0, 0.0, 0.5], "around the camera"),
        ([20.0, 0.0, 10.0], "right of the view"),
        ([0.0, -20.0, 10.0], "above the view"),
        ([0.0, 0.0, 60.0], "smaller than the least size"),
    ],
)
def test_there_is_no_box_of_a_target_outside_of_the_frame(wide: Camera, place: list[float], why: str) -> None:
    assert not expose(wide, cube(*place)).box.present, why


def test_there_is_no_box_without_light(wide: Camera) -> None:
    frame = expose(wide, cube(0.0, 0.0, 9.0), observable=NO)
    assert not frame.box.present
    assert not frame.observable


def test_a_target_cut_by_the_edge_of_the_frame_has_a_truncated_box_inside_of_the_frame(wide: Camera) -> None:
    box = expose(wide, cube(8.5, 0.0, 9.0)).box
    assert box.present
    assert box.truncated
    assert box.edges[2] == SIZE
    np.testing.assert_allclose(box.edges[0], 64 + FOCAL * 7.5 / 10.0, atol=EXACT)


def test_one_frame_in_twenty_misses_the_target(wide: Camera) -> None:
    frames = many(replace(wide, outlier_probability=jnp.zeros(())), cube(0.0, 0.0, 9.0))
    assert_share(1.0 - frames.box.present.mean(), 0.05)


def test_edge_errors_have_their_standard_deviation(wide: Camera) -> None:
    hull = cube(0.0, 0.0, 9.0)
    frames = many(replace(wide, outlier_probability=jnp.zeros(())), hull)
    errors = frames.box.edges - np.asarray(expose(wide, hull).box.edges)
    np.testing.assert_allclose(errors.std(axis=0), 1.0, rtol=FOUR_SIGMA / np.sqrt(2 * FRAMES))


@pytest.mark.parametrize("place", [9.0, -9.0], ids=["in view", "behind"])
def test_one_box_in_twenty_is_false_whether_or_not_the_target_is_seen(wide: Camera, place: float) -> None:
    frames = many(wide, cube(0.0, 0.0, place))
    assert_share(frames.outlier.mean(), 0.05)
    assert np.all(frames.box.present[frames.outlier])
    assert_share(frames.box.present.mean(), 0.05 + 0.95 * 0.95 if place > 0.0 else 0.05)


def test_false_boxes_lie_anywhere_in_the_frame_with_log_uniform_sides_within_their_bounds(wide: Camera) -> None:
    # A large frame cuts few of them.
    frames = many(replace(wide, outlier_probability=jnp.ones(())), cube(0.0, 0.0, -9.0), size=4096, seed=1)
    edges, whole = frames.box.edges, ~frames.box.truncated
    assert edges.min() >= 0.0
    assert edges.max() <= 4096.0
    assert_share(whole.mean(), (1 - 2 * np.mean(0.5 * np.geomspace(4, 64, 1000)) / 4096) ** 2)
    sides = (edges[:, 2:] - edges[:, :2])[whole]
    assert sides.min() > 4.0 - 1e-9
    assert sides.max() < 64.0 + 1e-9
    assert_share(np.mean(sides[:, 0] < 16.0), 0.5, of=whole.sum())
    assert_share(np.mean(sides[:, 1] < 8.0), 0.25, of=whole.sum())
    centers = 0.5 * (edges[:, :2] + edges[:, 2:])
    for axis in range(2):
        counts = np.histogram(centers[:, axis], bins=8, range=(0.0, 4096.0))[0]
        assert np.all(np.abs(counts - FRAMES / 8) < FOUR_SIGMA * np.sqrt(FRAMES / 8))


def test_false_boxes_at_the_border_of_the_frame_are_truncated(wide: Camera) -> None:
    frames = many(replace(wide, outlier_probability=jnp.ones(())), cube(0.0, 0.0, -9.0))
    edges = frames.box.edges
    assert edges.min() == 0.0
    assert edges.max() == SIZE
    touching = np.any((edges == 0.0) | (edges == SIZE), axis=1)
    np.testing.assert_array_equal(frames.box.truncated, touching)


@pytest.mark.parametrize(("observable", "working"), [(YES, NO), (NO, YES)], ids=["failed", "in the dark"])
def test_a_failed_camera_or_darkness_gives_no_box_not_even_a_false_one(
    wide: Camera, observable: jax.Array, working: jax.Array
) -> None:
    frames = many(wide, cube(0.0, 0.0, 9.0), observable=observable, working=working)
    assert not np.any(frames.box.present)
    # What is observable is a matter of light alone, not of the camera's health.
    np.testing.assert_array_equal(frames.observable, bool(observable))
