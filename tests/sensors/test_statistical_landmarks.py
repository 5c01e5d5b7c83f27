"""Landmarks that a statistical camera draws: where they are, how often, and how alike from picture to picture."""

import functools
import itertools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy.spatial.transform import Rotation
from synthetic_camera_statistics import fitted

from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.sensors import statistical_camera_file, statistical_landmarks
from rpojax.sensors.additional.landmark_scene import FoundInPicture, LandmarkScene
from rpojax.sensors.statistical_landmarks import LandmarkStatistics
from rpojax.sensors.view_features import FEATURE_COUNT
from rpojax.vision.surface.landmark_selection import select_landmarks
from rpojax.vision.surface.landmarks import Landmarks
from tests import surface_meshes

COUNT, DRAWS = 8, 4000
FOUND, SIGMA_SHARE, SIZE, FOCAL = 0.8, 0.02, 100.0, 400.0
SHARE, ANGLE = 0.7, 0.2
TURN = Rotation.from_rotvec(np.radians(70.0) * np.array([2.0, -1.0, 2.0]) / 3.0)
OFFSET = np.array([0.02, 0.0, -0.01])


@functools.cache
def cube() -> Landmarks:
    """Corners of a cube of 1 m."""
    with jax.ensure_compile_time_eval():
        return select_landmarks(surface_meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), 12)


def statistics(false: float) -> LandmarkStatistics:
    """Statistics that are the same for all views."""
    last = np.zeros(statistical_landmarks.output_count(COUNT), np.float32)
    last[0], last[1 : 1 + COUNT] = np.log(false / (1.0 - false)), np.log(FOUND / (1.0 - FOUND))
    last[1 + COUNT :] = np.log(SIGMA_SHARE) + 4.0
    widths = (*statistical_camera_file.LAYER_WIDTHS[:-1], len(last))
    layers = [(jnp.zeros((i, o), jnp.float32), jnp.zeros((o,), jnp.float32)) for i, o in itertools.pairwise(widths)]
    layers[-1] = (layers[-1][0], jnp.asarray(last))
    return LandmarkStatistics(
        mean=jnp.zeros(FEATURE_COUNT, jnp.float32),
        spread=jnp.ones(FEATURE_COUNT, jnp.float32),
        layers=tuple(layers),
        error_scale=jnp.asarray(0.8, jnp.float32),
        tail=jnp.asarray(0.5, jnp.float32),
        lasting_share=jnp.asarray(SHARE, jnp.float32),
        lasting_angle=jnp.asarray(ANGLE, jnp.float32),
        false_turn=jnp.asarray(np.roll(TURN.as_quat(), 1), jnp.float32),
    )


def scene() -> LandmarkScene:
    turn = quaternion.to_matrix(quaternion.normalize(jnp.array([0.9, 0.2, -0.3, 0.1])))
    return LandmarkScene(
        landmarks=cube(),
        scale=jnp.ones(()),
        R_KT=turn,
        r_TK_K=jnp.array([0.1, -0.05, 5.0]),
        sun_T=jnp.array([1.0, 0.0, 0.0]),
        focal_px=jnp.asarray(FOCAL),
        nominal_focal_px=jnp.asarray(FOCAL),
        half_frame_tangent=jnp.array([1.0, 1.0]),
        observable=jnp.ones((), bool),
        by_lamp_alone=jnp.zeros((), bool),
        working=jnp.ones((), bool),
    )


def drawn(false: float, lasting: Array, normals: Array, has_box: bool = True) -> FoundInPicture:
    one = functools.partial(
        statistical_landmarks.draw,
        statistics(false),
        scene(),
        jnp.asarray(OFFSET),
        jnp.zeros(FEATURE_COUNT, jnp.float32),
        jnp.asarray(SIZE),
        jnp.asarray(has_box),
    )
    return jax.jit(jax.vmap(one))(lasting, normals)


def numbers(seed: int) -> Array:
    count = statistical_landmarks.normal_count(COUNT)
    return jnp.asarray(np.random.default_rng(seed).normal(size=(DRAWS, count)))


def test_landmarks_are_where_they_are_with_the_errors_of_the_statistics() -> None:
    found = drawn(1e-9, numbers(0), numbers(1))
    true = np.asarray(scene().tangents(cube().positions + OFFSET[None]))
    sigma = SIGMA_SHARE * SIZE / FOCAL
    np.testing.assert_allclose(found.sigma, sigma, rtol=1e-5)
    errors = (np.asarray(found.tangents) - true) / sigma
    # Of sinh(x / 2) 2 with x normal: the variance is (e^(1 / 2) - 1) / 2 over a quarter.
    expected = 0.8 * np.sqrt((np.exp(2.0 * 0.25) - 1.0) / 2.0) / 0.5
    assert errors.std() == pytest.approx(expected, rel=0.02)
    assert abs(errors.mean()) < 0.02
    assert np.asarray(found.present).mean() == pytest.approx(FOUND, abs=0.01)
    assert not np.asarray(drawn(1e-9, numbers(0), numbers(1), has_box=False).present).any()


def test_a_share_of_pictures_shows_a_target_that_is_turned() -> None:
    found = drawn(0.1, numbers(2), numbers(3))
    right, turned = (
        np.asarray(scene().tangents(jnp.asarray(np.asarray(cube().positions) @ turn.T + OFFSET)))
        for turn in (np.eye(3), TURN.as_matrix())
    )
    off = [np.linalg.norm(np.asarray(found.tangents) - each, axis=2).mean(axis=1) for each in (right, turned)]
    is_false = off[1] < off[0]
    assert is_false.mean() == pytest.approx(0.1, abs=0.02)
    assert np.median(off[1][is_false]) == pytest.approx(np.median(off[0][~is_false]), rel=0.1)


def test_errors_of_two_pictures_are_alike_by_share_and_turn() -> None:
    turn, given = 0.1, statistics(1e-9)
    first = numbers(4)
    later = jax.vmap(lambda a, b: statistical_landmarks.advance(given.lasting_angle, a, jnp.asarray(turn), b))(
        first, numbers(5)
    )
    assert np.asarray(later).std() == pytest.approx(1.0, abs=0.02)
    plain = replace(given, tail=jnp.asarray(1e-3, jnp.float32))
    places = [
        np.asarray(
            jax.vmap(
                lambda a, b: (
                    statistical_landmarks.draw(
                        plain,
                        scene(),
                        jnp.zeros(3),
                        jnp.zeros(FEATURE_COUNT),
                        jnp.asarray(SIZE),
                        jnp.asarray(True),
                        a,
                        b,
                    ).tangents
                )
            )(lasting, normals)
        )
        for lasting, normals in ((first, numbers(6)), (later, numbers(7)))
    ]
    one, other = (each - each.mean(axis=0) for each in places)
    correlation = np.mean(one * other) / np.sqrt(np.mean(one**2) * np.mean(other**2))
    assert correlation == pytest.approx(SHARE * np.exp(-turn / ANGLE), abs=0.02)


def test_statistics_with_landmarks_survive_a_file(tmp_path: Path) -> None:
    given = replace(fitted(0.7, 0.1), landmarks=statistics(0.05))
    statistical_camera_file.save_statistics(given, tmp_path / "a.camera.safetensors", {})
    found, _ = statistical_camera_file.load_statistics(tmp_path / "a.camera.safetensors")
    assert jax.tree.structure(found) == jax.tree.structure(given)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(given), strict=True):
        np.testing.assert_array_equal(a, b)
