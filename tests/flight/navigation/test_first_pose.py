"""First pose of the target from one picture: where it is, what is believed of it, and what is not believed."""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy.spatial.transform import Rotation

from rpojax import nominal_parameters
from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.flight.navigation import landmark_measurement, relative_filter_state, target_attitude_ekf
from rpojax.flight.navigation.landmark_measurement import LandmarkView
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.target_attitude_ekf import BelievedTarget
from rpojax.scenario.loading import scenario_loader

COUNT, CASES = 10, 50
LANDMARKS = np.random.default_rng(4).uniform(-0.6, 0.6, size=(COUNT, 3))
SIGMA, ATTITUDE_SIGMA = 1e-3, 5e-3
"""Of a tangent, and of the attitude filter about each axis; that one far larger than it is, so that it counts."""
PRIOR = {"position": 1.0, "velocity": 0.01, "bearing_bias": 1e-2, "body_offset": 0.02}
"""Sigmas of the estimate before."""
NETWORK = ("landmarks", "landmark_network")
"""What a filter has states for whose landmarks are those of a network."""
TURN_SIGMA, SHIFT_SIGMA = np.array([0.03, 0.03, 0.01]), np.array([1e-3, 1e-3, 0.01])
"""Of its turn of the target [rad], and of its place over the range, in K."""
LEARNT = {"bearing_bias": np.array([0.03, -0.02]), "body_offset": np.array([0.06, -0.05, 0.04])}
"""What it has of bearing and body, as where it has had an attitude before."""


class Case(NamedTuple):
    """Truth, and what flight software has of it.

    Attributes:
        q_TN: (4,) true attitude of the target
        r_TS_N: (3,) its true place
        bearing_bias: (2,) true one
        body_offset: (3,) true one
        believed_N: (3,) place that the filter has
        view: of the camera
    """

    q_TN: Any
    r_TS_N: Any
    bearing_bias: Any
    body_offset: Any
    believed_N: Any
    view: LandmarkView


@functools.cache
def tuning_and_target(
    sensors: tuple[str, ...] = ("landmarks",),
) -> tuple[OrbitFilterTuning, BelievedTarget, RelativeEstimate]:
    with jax.ensure_compile_time_eval():
        params = nominal_parameters(scenario_loader.load("pose_inspection"))[1]
        assert params.flight.target is not None
        target = replace(params.flight.target, landmarks=jnp.asarray(LANDMARKS))
        states = relative_filter_state.states_with(sensors)
        start = jnp.array([6.0, 0.0, 0.0]), jnp.zeros(3)
        estimate = relative_filter_state.initial(params.flight.navigation, *start, states, target)
        sigma = np.sqrt(np.diag(np.asarray(estimate.covariance)))
        for name, value in PRIOR.items():
            sigma[estimate.layout[name]] = value
        if "network_turn" in estimate.layout:
            sigma[estimate.layout["network_turn"]] = TURN_SIGMA
            sigma[estimate.layout["network_place"]] = SHIFT_SIGMA
        slow = estimate.slow | {name: jnp.asarray(value) for name, value in LEARNT.items()}
        covariance = jnp.diag(jnp.asarray(sigma**2))
        return params.flight.navigation, target, replace(estimate, slow=slow, covariance=covariance)


def case(seed: int, depth: tuple[float, float] = (6.0, 12.0)) -> Case:
    """Random attitudes and errors; the target at a depth between two [m] near the boresight."""
    rng = np.random.default_rng(seed)
    R_TN, R_KN = (Rotation.from_quat(rng.normal(size=4)) for _ in range(2))
    place_K = rng.uniform(*depth) * np.array([*rng.uniform(-0.08, 0.08, 2), 1.0])
    bias, offset = (LEARNT[name] + PRIOR[name] * rng.normal(size=len(LEARNT[name])) for name in LEARNT)
    places_K = (R_KN * R_TN.inv()).apply(LANDMARKS + offset) + place_K
    noise = SIGMA * rng.normal(size=(COUNT, 2))
    believed_KN = Rotation.from_rotvec(ATTITUDE_SIGMA * rng.normal(size=3)) * R_KN
    view = LandmarkView(
        tangents=jnp.asarray(places_K[:, :2] / places_K[:, 2:] + bias + noise),
        variance=jnp.full(COUNT, SIGMA**2),
        present=jnp.ones(COUNT, dtype=bool),
        q_KN=quaternion.from_matrix(jnp.asarray(believed_KN.as_matrix())),
        attitude_variance=jnp.asarray(ATTITUDE_SIGMA**2),
    )
    r_TS_N = R_KN.inv().apply(place_K)
    return Case(
        q_TN=quaternion.from_matrix(jnp.asarray(R_TN.as_matrix())),
        r_TS_N=jnp.asarray(r_TS_N),
        bearing_bias=jnp.asarray(bias),
        body_offset=jnp.asarray(offset),
        believed_N=jnp.asarray(r_TS_N + PRIOR["position"] * rng.normal(size=3)),
        view=view,
    )


@jax.jit
def acquired(given: Case) -> tuple[RelativeEstimate, Array]:
    """Estimate after the picture, and its errors in the order of its vector: those that a case has, else 0."""
    tuning, target, estimate = tuning_and_target()
    before = replace(estimate, r_TS_N=given.believed_N)
    after = landmark_measurement.acquired(tuning, target, before, given.view)
    assert after.target is not None
    found = target_attitude_ekf.attitude(after.target, after.slow)
    errors = after.layout.vector(
        position=given.r_TS_N - after.r_TS_N,
        velocity=jnp.zeros(3),
        **{name: jnp.zeros_like(value) for name, value in after.slow.items()}
        | {
            "attitude": quaternion.log(quaternion.multiply(given.q_TN, quaternion.conjugate(found))),
            "bearing_bias": given.bearing_bias - after.slow["bearing_bias"],
            "body_offset": given.body_offset - after.slow["body_offset"],
        },
    )
    return after, errors


def numbers_of(*names: str) -> np.ndarray:
    layout = tuning_and_target()[2].layout
    return np.array([number for name in names for number in layout.places(name)])


def is_known(after: RelativeEstimate) -> bool:
    assert after.target is not None
    return bool(after.target.known)


def test_first_poses_are_where_the_target_is_with_the_covariance_that_they_say() -> None:
    numbers = numbers_of("attitude", "position", "bearing_bias", "body_offset")
    pose = numbers_of("attitude", "position")
    nees, sigmas = [], []
    for seed in range(CASES):
        after, errors = acquired(case(seed))
        assert is_known(after), seed
        P, error = np.asarray(after.covariance), np.asarray(errors)
        np.linalg.cholesky(P)
        nees.append(error[numbers] @ np.linalg.solve(P[np.ix_(numbers, numbers)], error[numbers]))
        sigmas.append(np.abs(error[pose]) / np.sqrt(np.diag(P)[pose]))
        np.testing.assert_allclose(P, P.T, atol=1e-15)
        # All that is known of the rate is how fast targets tumble.
        rate = after.layout["rate"]
        np.testing.assert_allclose(P[rate, rate], float(tuning_and_target()[0].tumble_sigma) ** 2 * np.eye(3))
        np.testing.assert_array_equal(after.slow["rate"], 0.0)
    assert np.max(sigmas) < 4.0
    # Mean of chi-square of eleven components, four of its sigmas.
    assert np.mean(nees) == pytest.approx(11.0, abs=4.0 * np.sqrt(2.0 * 11.0 / CASES))
    # The pose has told much: the filter had a metre.
    after, errors = acquired(case(0))
    assert np.linalg.norm(np.asarray(errors)[numbers_of("position")]) < 0.3


def test_first_poses_of_a_network_have_its_lasting_errors_in_their_covariance() -> None:
    tuning, target, estimate = tuning_and_target(NETWORK)
    layout = estimate.layout
    names = ("attitude", "position", "bearing_bias", "body_offset", "network_turn", "network_place")
    numbers = np.array([number for name in names for number in layout.places(name)])
    nees = []
    for seed in range(CASES):
        given, rng = case(seed), np.random.default_rng([seed, 1])
        turn, shift = TURN_SIGMA * rng.normal(size=3), SHIFT_SIGMA * rng.normal(size=3)
        seen = seen_by_network(given, turn, shift)
        after = jax.jit(landmark_measurement.acquired)(
            tuning, target, replace(estimate, r_TS_N=given.believed_N), replace(given.view, tangents=seen)
        )
        assert is_known(after), seed
        assert after.target is not None
        found = target_attitude_ekf.attitude(after.target, after.slow)
        of = {
            "attitude": quaternion.log(quaternion.multiply(given.q_TN, quaternion.conjugate(found))),
            "position": given.r_TS_N - after.r_TS_N,
            "bearing_bias": given.bearing_bias - after.slow["bearing_bias"],
            "body_offset": given.body_offset - after.slow["body_offset"],
            "network_turn": turn - after.slow["network_turn"],
            "network_place": shift - after.slow["network_place"],
        }
        error = np.concatenate([np.asarray(of[name]) for name in names])
        P = np.asarray(after.covariance)[np.ix_(numbers, numbers)]
        nees.append(error @ np.linalg.solve(P, error))
    assert np.mean(nees) == pytest.approx(17.0, abs=4.0 * np.sqrt(2.0 * 17.0 / CASES))


def seen_by_network(given: Case, turn: np.ndarray, shift: np.ndarray) -> Array:
    """Tangents of landmarks as a network shows them, of a target that is turned by `turn` and moved by `shift`."""
    R_TN = np.asarray(quaternion.to_matrix(given.q_TN))
    # The case has its camera by what flight software believes of it: the same to its own error.
    R_KN = np.asarray(quaternion.to_matrix(given.view.q_KN))
    place_K = R_KN @ np.asarray(given.r_TS_N)
    body_K = (LANDMARKS + np.asarray(given.body_offset)) @ R_TN @ R_KN.T
    true, shown = body_K + place_K, Rotation.from_rotvec(-turn).apply(body_K) + place_K
    shown = shown + np.linalg.norm(place_K) * shift
    return given.view.tangents + jnp.asarray(shown[:, :2] / shown[:, 2:] - true[:, :2] / true[:, 2:])


def test_the_place_of_a_filter_that_knows_better_stays() -> None:
    given = case(3, (20.0, 25.0))
    tuning, target, estimate = tuning_and_target()
    place = estimate.layout["position"]
    sure = replace(
        estimate, r_TS_N=given.r_TS_N, covariance=estimate.covariance.at[place, place].set(1e-4 * jnp.eye(3))
    )
    after = jax.jit(landmark_measurement.acquired)(tuning, target, sure, given.view)
    assert is_known(after)
    np.testing.assert_array_equal(after.r_TS_N, sure.r_TS_N)
    np.testing.assert_array_equal(after.covariance[place, place], sure.covariance[place, place])


def unbelieved() -> dict[str, Case]:
    """Cases whose pose is not believed."""
    good = case(1)
    shown, away = good.view, jnp.array([6.0, 0.0, 0.0])
    random = 0.1 * jnp.asarray(np.random.default_rng(0).normal(size=(COUNT, 2)))
    one_false = shown.tangents.at[4].add(jnp.array([0.05, -0.05]))
    return {
        "the target is elsewhere": good._replace(believed_N=good.r_TS_N + away),
        "five landmarks": good._replace(view=replace(shown, present=jnp.arange(COUNT) < 5)),
        "no pose explains them": good._replace(view=replace(shown, tangents=random)),
        "one of them is false": good._replace(view=replace(shown, tangents=one_false)),
    }


@pytest.mark.parametrize("name", unbelieved())
def test_a_picture_that_contradicts_or_tells_too_little_is_not_believed(name: str) -> None:
    given = unbelieved()[name]
    after = acquired(given)[0]
    _, _, before = tuning_and_target()
    assert not is_known(after)
    np.testing.assert_array_equal(after.covariance, before.covariance)
    np.testing.assert_array_equal(after.r_TS_N, given.believed_N)


def test_six_landmarks_are_enough_and_a_known_attitude_is_kept() -> None:
    given = case(1)
    six = replace(given.view, present=jnp.arange(COUNT) < 6)
    after, _ = acquired(given._replace(view=six))
    assert is_known(after)
    tuning, target, _ = tuning_and_target()
    again = jax.jit(landmark_measurement.acquired)(tuning, target, after, case(2).view)
    assert jax.tree.all(jax.tree.map(np.array_equal, again, after))


def test_a_batch_acquires_where_it_is_wanted() -> None:
    both = jax.tree.map(lambda *each: jnp.stack(each), case(1), unbelieved()["five landmarks"])
    after, _ = jax.vmap(acquired)(both)
    assert after.target is not None
    assert after.target.known.tolist() == [True, False]
    alone, _ = acquired(case(1))
    np.testing.assert_allclose(after.covariance[0], alone.covariance, rtol=1e-8, atol=1e-12)
