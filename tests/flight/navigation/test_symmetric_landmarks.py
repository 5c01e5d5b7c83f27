"""Pictures of a body that looks alike in several attitudes: names of landmarks, votes, the turn to another attitude."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy_reference import random_covariance
from scipy.spatial.transform import Rotation

from rpojax import nominal_parameters
from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.flight.navigation import (
    landmark_measurement,
    relative_filter_state,
    symmetric_attitudes,
    symmetric_landmarks,
    target_attitude_ekf,
)
from rpojax.flight.navigation.landmark_measurement import LandmarkView
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.target_attitude_ekf import BelievedTarget
from rpojax.scenario.loading import scenario_loader
from rpojax.vision.surface.landmarks import with_symmetries
from rpojax.vision.surface.surface_symmetries import Symmetry

FOLDS, SIGMA = 4, 1e-3
AXIS_AT = np.array([0.03, -0.02, 0.0])
"""Place of the axis of the turns, beside the centre of mass [m]."""
TURNS = [Rotation.from_euler("z", 90.0 * number, degrees=True) for number in range(FOLDS)]
ONE_SIDE = np.array([[0.5, 0.1, 0.2], [0.4, -0.2, -0.3], [0.2, 0.25, 0.4]])
LANDMARKS = AXIS_AT + np.concatenate([turn.apply(ONE_SIDE) for turn in TURNS])
COUNT = len(LANDMARKS)


class Scene(NamedTuple):
    """What flight software has."""

    tuning: OrbitFilterTuning
    target: BelievedTarget
    estimate: RelativeEstimate


@functools.cache
def scene() -> Scene:
    """An estimate that is right, with correlated errors."""
    with jax.ensure_compile_time_eval():
        params = nominal_parameters(scenario_loader.load("pose_inspection"))[1]
        assert params.flight.target is not None
        symmetries = [Symmetry(turn.as_matrix(), AXIS_AT - turn.apply(AXIS_AT)) for turn in TURNS]
        table = np.ones((16, COUNT), dtype=bool)
        found = with_symmetries(LANDMARKS, np.ones_like(LANDMARKS), table, symmetries, None)
        alike = symmetric_attitudes.of_body(found.symmetries, found.shifts, found.permutations)
        target = replace(params.flight.target, landmarks=jnp.asarray(LANDMARKS), symmetries=alike)
        states = relative_filter_state.states_with(["landmarks"])
        start = jnp.array([0.3, -0.2, 6.0]), jnp.array([0.01, 0.02, 0.0])
        estimate = relative_filter_state.initial(params.flight.navigation, *start, states, target)
        assert estimate.target is not None
        known = symmetric_attitudes.begun(estimate.target.votes, jnp.asarray(True))
        q_TN = quaternion.normalize(jnp.array([0.4, -0.7, 0.5, 0.3]))
        reference = replace(estimate.target, q_TN=q_TN, known=jnp.asarray(True), votes=known)
        sigma = np.full(estimate.layout.size, 1e-3)
        P = random_covariance(np.random.default_rng(1), sigma)
        slow = estimate.slow | {
            "attitude": jnp.array([1e-3, -2e-3, 1e-3]),
            "rate": jnp.array([0.01, -0.02, 0.005]),
            "body_offset": jnp.array([0.01, 0.02, -0.01]),
            "inertia_ratio": jnp.array([0.05, -0.02]),
        }
        estimate = replace(estimate, covariance=jnp.asarray(P), slow=slow, target=reference)
        return Scene(params.flight.navigation, target, estimate)


def view_of(swap: int = 0, present: np.ndarray | None = None) -> LandmarkView:
    """Picture of the truth, whose landmarks have the names of those that the turn `swap` takes them to."""
    _, target, estimate = scene()
    assert target.symmetries is not None
    nothing = LandmarkView(
        tangents=jnp.zeros((COUNT, 2)),
        variance=SIGMA**2 * (1.0 + jnp.linspace(0.0, 1.0, COUNT)),
        present=jnp.asarray(np.ones(COUNT, dtype=bool) if present is None else present),
        q_KN=quaternion.normalize(jnp.array([1.0, 0.01, -0.02, 0.03])),
        attitude_variance=jnp.asarray(1e-8),
    )
    places, _ = landmark_measurement.expected(target, estimate, nothing)
    noise = SIGMA * np.random.default_rng(3).normal(size=(COUNT, 2))
    seen = replace(nothing, tangents=places + noise)
    order = target.symmetries.permutations[swap]
    return replace(seen, tangents=seen.tangents[order], variance=seen.variance[order], present=seen.present[order])


@jax.jit
def weighed(estimate: RelativeEstimate, view: LandmarkView, used: jax.Array) -> RelativeEstimate:
    tuning, target, _ = scene()
    return symmetric_landmarks.weighed(tuning, target, estimate, view, used)


as_held = jax.jit(lambda estimate, view: symmetric_landmarks.as_held(*scene()[:2], estimate, view))
YES, NO = jnp.asarray(True), jnp.asarray(False)


def votes_of(estimate: RelativeEstimate) -> np.ndarray:
    assert estimate.target is not None and estimate.target.votes is not None
    return np.asarray(estimate.target.votes)


def test_products_are_those_of_the_turns() -> None:
    alike = scene().target.symmetries
    assert alike is not None
    matrices = [np.asarray(quaternion.to_matrix(each)) for each in alike.turns]
    for a, first in enumerate(matrices):
        np.testing.assert_allclose(first, TURNS[a].as_matrix(), atol=1e-12)
        for b, second in enumerate(matrices):
            np.testing.assert_allclose(matrices[int(alike.products[a, b])], first @ second, atol=1e-9)


@pytest.mark.parametrize("swap", range(FOLDS))
def test_a_picture_of_any_names_is_one_of_the_attitude_that_is_held(swap: int) -> None:
    present = np.arange(COUNT) % 5 != 0
    found = as_held(scene().estimate, view_of(swap, present))
    jax.tree.map(np.testing.assert_array_equal, found, view_of(0, present))


def test_without_symmetries_nothing_is_done_and_nothing_kept() -> None:
    tuning, target, estimate = scene()
    assert estimate.target is not None
    plain, view = replace(target, symmetries=None), view_of(1)
    assert symmetric_landmarks.as_held(tuning, plain, estimate, view) is view
    assert symmetric_landmarks.weighed(tuning, plain, estimate, view, YES) is estimate
    fresh = target_attitude_ekf.unknown(plain)
    assert fresh.votes is None
    assert symmetric_attitudes.begun(None, YES) is None
    assert bool(replace(fresh, known=YES).certain)
    one = jnp.array([[1.0, 0.0, 0.0, 0.0]]), jnp.zeros((1, 3)), jnp.arange(COUNT, dtype=jnp.int32)[None]
    assert symmetric_attitudes.of_body(*one) is None


@pytest.mark.parametrize("swap", range(1, FOLDS))
def test_votes_turn_the_estimate_to_the_attitude_that_they_are_for(swap: int) -> None:
    _, target, before = scene()
    alike = target.symmetries
    assert alike is not None and before.target is not None
    view, after, pictures = view_of(swap), before, 0
    # The vote of the picture that the attitude was found in has to be outnumbered, too.
    while votes_of(after)[0] <= 1.0:
        assert after.target is not None and not bool(after.target.certain)
        assert np.isinf(after.attitude_sigma)
        after, pictures = weighed(after, view, YES), pictures + 1
    assert 15 < pictures < 25
    assert after.target is not None and bool(after.target.certain)
    # A picture whose landmarks have the names of those that a turn takes them to is one of a body turned back.
    number = (-swap) % FOLDS
    turn, layout = TURNS[number].as_matrix(), before.layout
    q_TN = target_attitude_ekf.attitude(after.target, after.slow)
    was = target_attitude_ekf.attitude(before.target, before.slow)
    np.testing.assert_allclose(quaternion.to_matrix(q_TN), turn @ quaternion.to_matrix(was), atol=1e-9)
    np.testing.assert_allclose(after.slow["rate"], turn @ before.slow["rate"], atol=1e-12)
    # What a camera sees, and how surely, is the same: by other names.
    order = np.asarray(alike.permutations[number])
    for now, then in zip(
        landmark_measurement.expected(target, after, view),
        landmark_measurement.expected(target, before, view),
        strict=True,
    ):
        np.testing.assert_allclose(np.asarray(now)[order], then, rtol=1e-6, atol=1e-11)
    # The picture that was read with other names is one of the attitude now.
    jax.tree.map(np.testing.assert_array_equal, as_held(after, view), view)
    np.testing.assert_array_equal(after.slow["inertia_ratio"], 0.0)
    ratio = layout["inertia_ratio"]
    assert (np.diag(after.covariance[ratio, ratio]) > np.diag(before.covariance[ratio, ratio])).all()
    # Votes for the former attitude are now those for the one that many turns back.
    votes = votes_of(after)
    assert np.argmax(votes) == 0
    assert votes[swap] == pytest.approx(np.exp(-pictures / symmetric_attitudes.MEMORY), rel=1e-2)


def test_only_pictures_that_are_used_vote_and_only_for_an_attitude_that_is_known() -> None:
    _, _, estimate = scene()
    assert estimate.target is not None
    view = view_of(2)
    np.testing.assert_array_equal(votes_of(weighed(estimate, view, NO)), votes_of(estimate))
    lost = replace(estimate, target=replace(estimate.target, known=NO))
    np.testing.assert_array_equal(votes_of(weighed(lost, view, YES)), votes_of(estimate))
    assert votes_of(weighed(estimate, view, YES))[2] == pytest.approx(1.0, abs=1e-6)


def test_a_batch_turns_where_it_is_wanted() -> None:
    _, _, estimate = scene()
    assert estimate.target is not None
    sure = jnp.array([1.0, 0.0, 30.0, 0.0])
    near = replace(estimate, target=replace(estimate.target, votes=sure))
    both = jax.tree.map(lambda *each: jnp.stack(each), near, estimate)
    after = jax.vmap(weighed, (0, None, None))(both, view_of(2), YES)
    alone = weighed(near, view_of(2), YES)
    np.testing.assert_allclose(after.covariance[0], alone.covariance, rtol=1e-9, atol=1e-18)
    np.testing.assert_array_equal(after.covariance[1], estimate.covariance)
    np.testing.assert_array_equal(after.r_TS_N[1], estimate.r_TS_N)


def counted(pictures: np.ndarray, votes: np.ndarray) -> np.ndarray:
    """Votes after each of the pictures, which speak for one alternative each."""

    def one(votes: jax.Array, picture: jax.Array) -> tuple[jax.Array, jax.Array]:
        after = symmetric_attitudes.voted(votes, jnp.eye(len(votes))[picture], YES)
        return after, after

    return np.asarray(jax.lax.scan(one, jnp.asarray(votes), jnp.asarray(pictures))[1])


def test_an_attitude_is_certain_after_as_many_pictures_as_the_margin_says() -> None:
    leads = jax.vmap(symmetric_attitudes.leads)(counted(np.zeros(40, dtype=int), np.zeros(2)))
    # Of n votes for one of two a tie has the probability 2^-n; the first ones weigh hardly less.
    assert 1 + int(np.argmax(np.asarray(leads)[:, 0] >= symmetric_attitudes.MARGIN)) in (15, 16)
    np.testing.assert_array_equal(leads[:, 1], 0.0)


@pytest.mark.parametrize(("swap", "alike"), [(0.5, 2), (0.75, 4)])
def test_swaps_as_frequent_as_chance_leave_it_unknown(swap: float, alike: int) -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        pictures = np.where(rng.random(2000) < swap, rng.integers(1, alike, 2000), 0)
        leads = jax.vmap(symmetric_attitudes.leads)(counted(pictures, np.zeros(alike)))
        assert np.asarray(leads).max() < symmetric_attitudes.MARGIN


def test_swaps_in_three_of_ten_pictures_make_it_known_and_keep_it_so() -> None:
    rng = np.random.default_rng(6)
    for _ in range(20):
        leads = jax.vmap(symmetric_attitudes.leads)(counted((rng.random(2000) < 0.3).astype(int), np.zeros(2)))
        certain = np.asarray(leads) >= symmetric_attitudes.MARGIN
        assert certain[600:, 0].mean() > 0.99
        assert not certain[:, 1].any()


def test_votes_are_bounded_so_that_they_can_change() -> None:
    sure = counted(np.zeros(20_000, dtype=int), np.zeros(3))[-1]
    assert sure[0] <= symmetric_attitudes.MEMORY + 1e-9
    leads = jax.vmap(symmetric_attitudes.better)(counted(np.full(600, 2), sure))
    best, switches = map(np.asarray, leads)
    assert 250 < int(np.argmax(switches)) < 450
    assert best[np.argmax(switches)] == 2
