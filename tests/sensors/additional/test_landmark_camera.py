"""Landmarks in pictures of a cube: where they are by OpenCV, which are seen in which light, and how often."""

import functools
from typing import Any

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy.spatial.transform import Rotation
from scipy.stats import binom, kstest

from rpojax.core.pytree import replace
from rpojax.sensors.additional.additional_sensor import SensedScene
from rpojax.sensors.additional.landmark_camera import LandmarkCamera
from rpojax.sensors.additional.landmark_scene import FoundInPicture, LandmarkScene
from rpojax.vision.surface.landmark_selection import select_landmarks
from rpojax.vision.surface.landmarks import Landmarks
from tests import surface_meshes

FOCAL_PX, NOMINAL_PX = 510.0, 500.0
SURE = {
    "noise": 0.0,
    "shaded_noise": 0.0,
    "miss_probability": 0.0,
    "shaded_miss_probability": 0.0,
    "outlier_probability": 0.0,
    "swap_probability": 0.0,
    "minimum_size": 1.0,
    "body_offset": np.zeros(3),
}
"""A camera that finds all that is in sight, where it is."""
FROM_OCTANT = np.array([2.9, 3.1, 4.6])
"""Of the camera from the target in T [m]: it sees three faces of the cube."""
FROM_FACE = np.array([0.1, -0.1, 6.0])
"""It sees the face of +z alone."""
SUN = np.array([0.2, -0.9, 0.4])
COUNT = 8


@functools.cache
def cube() -> Landmarks:
    """Corners of a cube of 1 m."""
    with jax.ensure_compile_time_eval():
        return select_landmarks(surface_meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), 12)


def scene(camera_T: np.ndarray = FROM_OCTANT, aside: float = 0.0, seed: int = 1, **changes: Any) -> LandmarkScene:
    """A cube before a camera at `camera_T` from it, whose boresight is `aside` [rad] of its centre."""
    forward = -camera_T / np.linalg.norm(camera_T)
    turn = Rotation.from_rotvec(np.random.default_rng(seed).normal(size=3))
    z_T = Rotation.align_vectors(forward[None], np.array([[0.0, 0.0, 1.0]]))[0]
    R_KT = Rotation.from_rotvec([0.0, aside, 0.0]) * Rotation.from_rotvec([0.0, 0.0, turn.magnitude()]) * z_T.inv()
    given: dict[str, Any] = {
        "landmarks": cube(),
        "scale": jnp.ones(()),
        "R_KT": jnp.asarray(R_KT.as_matrix()),
        "r_TK_K": jnp.asarray(R_KT.apply(-camera_T)),
        "sun_T": jnp.asarray(SUN / np.linalg.norm(SUN)),
        "focal_px": jnp.asarray(FOCAL_PX),
        "nominal_focal_px": jnp.asarray(NOMINAL_PX),
        "half_frame_tangent": jnp.array([0.5, 0.5]),
        "observable": jnp.asarray(True),
        "by_lamp_alone": jnp.asarray(False),
        "working": jnp.asarray(True),
    }
    return LandmarkScene(**{**given, **changes})


def measured(
    picture: LandmarkScene, normals: np.ndarray | None = None, **settings: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Tangents (..., n, 2) and sigmas (..., n) by pictures of given random numbers, by default zeros."""
    numbers = {name: jnp.asarray(value) for name, value in {**SURE, **settings}.items()}

    def measure(drawn: Array) -> dict[str, Array]:
        nothing: Any = None
        sensed = SensedScene(truth=nothing, sky=nothing, time=jnp.zeros(()), landmarks=picture)
        return LandmarkCamera.measure(numbers, sensed, drawn)

    given = jnp.asarray(np.zeros(LandmarkCamera.normals) if normals is None else normals)
    found = jax.jit(jax.vmap(measure) if given.ndim > 1 else measure)(given)
    tangents = np.stack([found["landmarks_right_tangent"], found["landmarks_down_tangent"]], axis=-1)
    assert np.array_equal(np.isfinite(tangents).all(axis=-1), np.isfinite(found["landmarks_sigma_tangent"]))
    return tangents, np.asarray(found["landmarks_sigma_tangent"])


def is_found(tangents: np.ndarray) -> np.ndarray:
    return np.isfinite(tangents).all(axis=-1)


def is_visible(camera_T: np.ndarray) -> np.ndarray:
    """Whether the camera is in front of a face with each corner: the cube is convex."""
    outside = 2.0 * np.asarray(cube().positions) * camera_T > 0.5
    return outside.any(axis=1)


def is_lit(sun_T: np.ndarray) -> np.ndarray:
    """Whether the Sun is in front of a face with each corner, and of the mean of them."""
    corners = np.asarray(cube().positions)
    return np.asarray(np.any(corners * sun_T > 0.0, axis=1) & (corners @ sun_T > 0.0))


@pytest.mark.parametrize("offset", [np.zeros(3), np.array([0.03, -0.02, 0.05])])
@pytest.mark.parametrize("scale", [1.0, 1.3])
def test_landmarks_are_where_opencv_projects_them(scale: float, offset: np.ndarray) -> None:
    picture = scene(scale=jnp.asarray(scale), aside=0.05)
    matrix = np.array([[FOCAL_PX, 0.0, 0.0], [0.0, FOCAL_PX, 0.0], [0.0, 0.0, 1.0]])
    places = scale * np.asarray(cube().positions) + offset
    turn = cv2.Rodrigues(np.asarray(picture.R_KT))[0]
    pixels = cv2.projectPoints(places, turn, np.asarray(picture.r_TK_K), matrix, np.zeros(5))[0][:, 0]
    tangents, sigma = measured(picture, body_offset=offset, noise=0.5, shaded_noise=2.0)
    seen = is_visible(FROM_OCTANT)
    assert seen.sum() == 7
    np.testing.assert_array_equal(is_found(tangents), seen)
    # Flight software divides by the focal length that it knows.
    np.testing.assert_allclose(tangents[seen], pixels[seen] / NOMINAL_PX, atol=1e-9)
    np.testing.assert_allclose(sigma[seen], np.where(is_lit(SUN), 0.5, 2.0)[seen] / NOMINAL_PX, rtol=1e-12)


def test_hidden_landmarks_are_never_shown() -> None:
    drawn = np.random.default_rng(0).normal(size=(200, LandmarkCamera.normals))
    for camera_T in (FROM_OCTANT, FROM_FACE, -FROM_OCTANT, -FROM_FACE):
        found = is_found(measured(scene(camera_T), drawn, noise=1.0, shaded_noise=1.0, outlier_probability=0.3)[0])
        np.testing.assert_array_equal(found.any(axis=0), is_visible(camera_T))


@pytest.mark.parametrize("change", ["observable", "working"])
def test_there_is_none_in_the_dark_or_without_a_camera(change: str) -> None:
    off: dict[str, Any] = {change: jnp.asarray(False)}
    assert not is_found(measured(scene(**off))[0]).any()


def test_by_the_lamp_alone_what_is_seen_is_lit() -> None:
    picture = scene(by_lamp_alone=jnp.asarray(True))
    sigma = measured(picture, noise=0.5, shaded_noise=2.0)[1]
    np.testing.assert_allclose(sigma[is_visible(FROM_OCTANT)], 0.5 / NOMINAL_PX, rtol=1e-12)


def test_there_is_none_outside_of_the_frame_or_behind_the_camera() -> None:
    for aside in (0.0, 0.42, 0.5, 0.58):
        picture = scene(aside=aside)
        wide = replace_frame(picture, 10.0)
        everywhere = measured(wide)[0]
        inside = np.all(np.abs(everywhere) < 0.5, axis=1)
        np.testing.assert_array_equal(is_found(measured(picture)[0]), inside)
    # The middle one cuts the cube.
    assert 0 < np.sum(np.all(np.abs(measured(replace_frame(scene(aside=0.5), 10.0))[0]) < 0.5, axis=1)) < 7
    assert not is_found(measured(replace_frame(scene(aside=np.pi), 1e6))[0]).any()


def replace_frame(picture: LandmarkScene, half: float) -> LandmarkScene:
    return LandmarkScene(**{**vars(picture), "half_frame_tangent": jnp.array([half, half])})


def test_a_small_picture_shows_none() -> None:
    # Corners are 0.866 m from the centre, at 6.26 m.
    size = 2.0 * np.sqrt(0.75) / np.linalg.norm(FROM_OCTANT) * FOCAL_PX
    assert is_found(measured(scene(), minimum_size=0.999 * size)[0]).any()
    assert not is_found(measured(scene(), minimum_size=1.001 * size)[0]).any()


PICTURES = 4000
RATES = {"miss_probability": 0.12, "shaded_miss_probability": 0.45, "outlier_probability": 0.05}


@functools.cache
def many() -> tuple[np.ndarray, np.ndarray]:
    """Tangents of many pictures with noise, misses and false places, in a frame that holds all, and without any."""
    drawn = np.random.default_rng(5).normal(size=(PICTURES, LandmarkCamera.normals))
    picture = replace_frame(scene(), 100.0)
    return measured(picture, drawn, noise=0.7, shaded_noise=1.4, **RATES)[0], measured(picture)[0]


def test_landmarks_are_missed_as_often_as_said_in_light_and_in_shade() -> None:
    found, lit = is_found(many()[0]), is_lit(SUN)
    for number in np.flatnonzero(is_visible(FROM_OCTANT)):
        rate = RATES["miss_probability" if lit[number] else "shaded_miss_probability"]
        # Beyond these bounds once in a thousand for each.
        assert (
            binom.ppf(5e-4, PICTURES, 1.0 - rate) <= found[:, number].sum() <= binom.ppf(1 - 5e-4, PICTURES, 1.0 - rate)
        )
    assert 0 < (is_visible(FROM_OCTANT) & lit).sum() < 7


def test_false_places_are_as_often_as_said_and_about_the_target_and_others_have_the_noise() -> None:
    tangents, ideal = many()
    lit, seen = is_lit(SUN), is_visible(FROM_OCTANT)
    off = (tangents - ideal) * NOMINAL_PX
    far = np.abs(off).max(axis=-1) > 6.0 * 1.4
    # A false place is by chance near the right one: 17 px of a sigma of 71 px along each axis, at most 4 %.
    count = (far & is_found(tangents))[:, seen].sum()
    trials, rate = PICTURES * seen.sum(), RATES["outlier_probability"]
    assert binom.ppf(5e-4, trials, 0.95 * rate) <= count <= binom.ppf(1 - 5e-4, trials, rate)
    half_size = np.sqrt(0.75) / np.linalg.norm(FROM_OCTANT) * FOCAL_PX / NOMINAL_PX
    false = (tangents - np.asarray(scene().r_TK_K)[:2] / np.linalg.norm(FROM_OCTANT))[far & is_found(tangents)]
    assert np.std(false) == pytest.approx(half_size, rel=0.05)
    for is_of, noise in ((seen & lit, 0.7), (seen & ~lit, 1.4)):
        right = off[:, is_of][is_found(tangents)[:, is_of] & ~far[:, is_of]]
        assert kstest(right.ravel() / noise, "norm").pvalue > 1e-3


def test_swapped_landmarks_are_those_of_a_symmetric_attitude() -> None:
    drawn = np.zeros((PICTURES, LandmarkCamera.normals))
    drawn[:, -2:] = np.random.default_rng(9).normal(size=(PICTURES, 2))
    picture = replace_frame(scene(), 100.0)
    tangents, ideal = measured(picture, drawn, swap_probability=0.3)[0], measured(picture)[0]
    permutations = np.asarray(cube().permutations)
    assert len(permutations) == 24
    which = np.array(
        [[np.array_equal(each, ideal[order], equal_nan=True) for order in permutations] for each in tangents]
    )
    np.testing.assert_array_equal(which.sum(axis=1), 1)
    counts = which.sum(axis=0)
    assert binom.ppf(5e-4, PICTURES, 0.7) <= counts[0] <= binom.ppf(1 - 5e-4, PICTURES, 0.7)
    for count in counts[1:]:  # all others alike
        assert binom.ppf(2e-5, PICTURES, 0.3 / 23) <= count <= binom.ppf(1 - 2e-5, PICTURES, 0.3 / 23)


def test_order_is_the_permutation_of_each_symmetry() -> None:
    picture, permutations = scene(), np.asarray(cube().permutations)
    np.testing.assert_array_equal(picture.order(jnp.asarray(False), jnp.asarray(0.7)), np.arange(COUNT))
    for which, number in ((0.0, 1), (0.5 / 23, 1), (11.5 / 23, 12), (1.0, 23)):
        np.testing.assert_array_equal(picture.order(jnp.asarray(True), jnp.asarray(which)), permutations[number])
    alone = replace(cube(), permutations=cube().permutations[:1])
    without = scene(landmarks=alone)
    np.testing.assert_array_equal(without.order(jnp.asarray(True), jnp.asarray(0.7)), np.arange(COUNT))


def test_landmarks_of_a_rendered_picture_are_those_of_the_network() -> None:
    places = np.random.default_rng(5).normal(0.0, 0.05, size=(COUNT, 2))
    present = np.arange(COUNT) % 3 > 0
    network = FoundInPicture(
        tangents=jnp.asarray(places), sigma=jnp.linspace(1e-3, 2e-3, COUNT), present=jnp.asarray(present)
    )
    nothing: Any = None
    sensed = SensedScene(truth=nothing, sky=nothing, time=jnp.zeros(()), landmarks=replace(scene(), found=network))
    found = LandmarkCamera.measure(SURE, sensed, jnp.zeros(LandmarkCamera.normals))
    names = ("right", "down", "sigma")
    expected = np.column_stack([places, np.linspace(1e-3, 2e-3, COUNT)])
    shown = np.column_stack([found[f"landmarks_{name}_tangent"] for name in names])
    np.testing.assert_allclose(shown[present], expected[present])
    assert np.isnan(shown[~present]).all()
