"""Poses from landmarks against OpenCV, covariance against scatter, derivatives against differences, and limits."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from experiment_modules import load_experiment
from jaxtyping import Array

from rpojax.batching.vmap_last_axis import vmap
from rpojax.core import quaternion
from rpojax.flight.navigation.perspective_n_point import FEWEST, PoseHypotheses, solve_pose

LANDMARKS = np.random.default_rng(4).uniform(-0.6, 0.6, size=(10, 3))
ATTITUDE = quaternion.normalize(jnp.array([0.4, -0.7, 0.5, 0.3]))
POSITION = jnp.array([0.3, -0.2, 6.0])
SIGMA = 1e-3


def image_of(points: np.ndarray, attitude: Array = ATTITUDE, position: Array = POSITION) -> np.ndarray:
    """Image coordinates (n, 2) of landmarks."""
    places = points @ np.asarray(quaternion.to_matrix(attitude)).T + np.asarray(position)
    return places[:, :2] / places[:, 2:]


@jax.jit
def solved(landmarks: Array, image: Array, weights: Array) -> PoseHypotheses:
    return solve_pose(landmarks, image, weights)


def solve(points: np.ndarray, image: np.ndarray, weights: np.ndarray | None = None) -> PoseHypotheses:
    known = np.full(len(points), SIGMA**-2) if weights is None else weights
    return solved(jnp.asarray(points), jnp.asarray(image), jnp.asarray(known))


def angle_from(attitude: Array, other: Array = ATTITUDE) -> float:
    """Angle [rad] between two attitudes."""
    return float(np.linalg.norm(quaternion.log(quaternion.multiply(attitude, quaternion.conjugate(other)))))


def test_the_optimum_is_that_of_opencv_and_never_a_worse_one() -> None:
    module = load_experiment("pose/perspective_n_point.py")
    cases = module.random_cases(50, 11)
    assert len(cases.image) == 50
    for name, found in module.compare(cases).items():
        assert not found["theirs"].any(), name
        assert len(found["angles"]) >= 40, name
        assert found["angles"].max() <= module.TOLERANCE, name
        assert found["shifts"].max() <= module.TOLERANCE, name


def test_a_pose_without_noise_is_found_again() -> None:
    found = solve(LANDMARKS, image_of(LANDMARKS))
    assert bool(found.enough)
    assert bool(found.exists[0])
    assert angle_from(found.q_KT[0]) < 1e-9
    np.testing.assert_allclose(found.r_TK_K[0], POSITION, atol=1e-9)
    assert float(found.cost[0]) < 1e-12
    assert np.all(np.diff(np.asarray(found.cost)[np.asarray(found.exists)]) >= 0.0)


def test_landmarks_that_are_not_seen_are_of_no_effect() -> None:
    image = image_of(LANDMARKS)
    weights = np.where(np.arange(10) < 6, SIGMA**-2, 0.0)
    image[6:] = np.nan
    found, expected = solve(LANDMARKS, image, weights), solve(LANDMARKS[:6], image[:6])
    assert angle_from(found.q_KT[0], expected.q_KT[0]) < 1e-9
    np.testing.assert_allclose(found.information[0], expected.information[0], rtol=1e-6)


def test_the_covariance_is_the_scatter_of_poses() -> None:
    count, sigma = 2000, 2e-3
    noise = sigma * np.random.default_rng(8).normal(size=(count, 10, 2))
    weights = jnp.full(10, sigma**-2)
    batch = jax.jit(jax.vmap(solve_pose, in_axes=(None, 0, None)))
    found = batch(jnp.asarray(LANDMARKS), jnp.asarray(image_of(LANDMARKS) + noise), weights)
    turn = jax.vmap(lambda q: quaternion.log(quaternion.multiply(q, quaternion.conjugate(ATTITUDE))))(found.q_KT[:, 0])
    errors = np.concatenate([turn, np.asarray(found.r_TK_K[:, 0]) - np.asarray(POSITION)], axis=1)
    normalised = np.einsum("ci,cij,cj->c", errors, found.information[:, 0], errors)
    # Mean and variance of chi-square with six degrees of freedom are 6 and 12.
    assert normalised.mean() == pytest.approx(6.0, abs=4.0 * np.sqrt(12.0 / count) + 0.05)
    np.testing.assert_allclose(found.covariance[0, 0] @ found.information[0, 0], np.eye(6), atol=1e-8)


def test_a_flat_target_has_two_hypotheses() -> None:
    flat = LANDMARKS * [1.0, 1.0, 0.0]
    attitude = quaternion.exp(jnp.array([2.6, 0.0, 0.0]))
    far = jnp.array([0.0, 0.0, 15.0])
    found = solve(flat, image_of(flat, attitude, far))
    assert np.asarray(found.exists).sum() == 2
    assert angle_from(found.q_KT[0], attitude) < 1e-7
    # The other one is mirrored at the plane normal to the line of sight.
    mirrored = quaternion.exp(jnp.array([2.0 * np.pi - 2.6, 0.0, 0.0]))
    assert angle_from(found.q_KT[1], mirrored) < 0.2
    assert 0.0 < float(found.cost[0]) + 1e-12 < float(found.cost[1]) < 30.0


@pytest.mark.parametrize("seen", [0, 1, 3])
def test_too_few_landmarks_are_said_to_be_so(seen: int) -> None:
    weights = np.where(np.arange(10) < seen, SIGMA**-2, 0.0)
    found = solve(LANDMARKS, image_of(LANDMARKS), weights)
    assert seen < FEWEST
    assert not bool(found.enough)
    assert not np.any(found.exists)
    assert (
        np.all(np.isfinite(found.q_KT)) and np.all(np.isfinite(found.r_TK_K)) and np.all(np.isfinite(found.covariance))
    )


def test_derivatives_of_the_pose_are_those_of_the_least_squares() -> None:
    image = image_of(LANDMARKS) + SIGMA * np.random.default_rng(5).normal(size=(10, 2))
    weights = jnp.full(10, SIGMA**-2)

    @jax.jit
    def pose(points: Array, coordinates: Array, known: Array) -> Array:
        found = solve_pose(points, coordinates, known)
        return jnp.concatenate([found.q_KT[0], found.r_TK_K[0]])

    given = (jnp.asarray(LANDMARKS), jnp.asarray(image), weights)
    derivatives = jax.jit(jax.jacrev(pose, argnums=(0, 1, 2)))(*given)
    for number, (value, derivative) in enumerate(zip(given, derivatives, strict=True)):
        step = 1e-6 * float(jnp.max(jnp.abs(value)))
        for entry in np.ndindex(2, *value.shape[1:]):
            moved = [
                pose(*(each.at[entry].add(sign * step) if n == number else each for n, each in enumerate(given)))
                for sign in (1.0, -1.0)
            ]
            slope = (moved[0] - moved[1]) / (2.0 * step)
            largest = float(jnp.max(jnp.abs(derivative)))
            np.testing.assert_allclose(derivative[(slice(None), *entry)], slope, atol=2e-6 * largest)


def test_a_weight_of_zero_and_an_unseen_landmark_have_finite_derivatives() -> None:
    weights = jnp.where(jnp.arange(10) < 6, SIGMA**-2, 0.0)
    gradient = jax.jit(jax.grad(lambda i, w: jnp.sum(solve_pose(jnp.asarray(LANDMARKS), i, w).r_TK_K[0]), (0, 1)))
    by_image, by_weight = gradient(jnp.asarray(image_of(LANDMARKS)), weights)
    assert np.all(np.isfinite(by_image)) and np.all(np.isfinite(by_weight))
    assert not np.any(by_image[6:])
    assert np.all(np.any(by_image[:6] != 0.0, axis=1))


def test_a_batch_over_the_last_axis_gives_the_same() -> None:
    noise = SIGMA * np.random.default_rng(2).normal(size=(10, 2, 3))
    images = jnp.asarray(image_of(LANDMARKS)[:, :, None] + noise)
    weights = jnp.full(10, SIGMA**-2)
    batched = jax.jit(vmap(partial(solve_pose, jnp.asarray(LANDMARKS)), (-1, None), -1))(images, weights)
    for number in range(3):
        alone = solve(LANDMARKS, np.asarray(images[:, :, number]))
        np.testing.assert_allclose(batched.q_KT[0, :, number], alone.q_KT[0], atol=1e-9)
        np.testing.assert_allclose(batched.covariance[0, :, :, number], alone.covariance[0], rtol=1e-6, atol=1e-12)


def test_single_precision_is_good_enough_to_begin_with() -> None:
    image = image_of(LANDMARKS) + SIGMA * np.random.default_rng(5).normal(size=(10, 2))
    given = [jnp.asarray(each, jnp.float32) for each in (LANDMARKS, image, np.full(10, SIGMA**-2))]
    with jax.enable_x64(False):
        found = jax.jit(solve_pose)(*given)
    expected = solve(LANDMARKS, image)
    assert bool(found.exists[0])
    assert angle_from(jnp.asarray(found.q_KT[0], jnp.float64), expected.q_KT[0]) < 1e-4
