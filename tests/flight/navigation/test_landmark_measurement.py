"""Rows of landmarks against all their tangents with dense noise, and first poses against the truth of pictures."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from numpy_reference import random_covariance

from rpojax import nominal_parameters
from rpojax.core import kalman_update, quaternion
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.pytree import replace
from rpojax.flight.navigation import landmark_measurement, relative_filter_state, target_attitude_ekf
from rpojax.flight.navigation.believed_sensor import SensorView
from rpojax.flight.navigation.landmark_measurement import LandmarkView
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.target_attitude_ekf import BelievedTarget
from rpojax.scenario.loading import scenario_loader

COUNT = 10
LANDMARKS = np.random.default_rng(4).uniform(-0.6, 0.6, size=(COUNT, 3))
SIGMA = 1e-3
"""Noise of a tangent."""
PLACE = np.array([0.4, -0.3, 6.0])
"""Of the target before the camera [m]."""
Q_KN = np.asarray(quaternion.normalize(jnp.array([0.8, 0.1, -0.5, 0.3])))
Q_TN = np.asarray(quaternion.normalize(jnp.array([0.4, -0.7, 0.5, 0.3])))
TINY = 1e-24
"""Variance of a common error that is as good as none."""


class Scene(NamedTuple):
    """What flight software has."""

    tuning: OrbitFilterTuning
    target: BelievedTarget
    estimate: RelativeEstimate


SENSORS = {"geometric": ("landmarks",), "network": ("landmarks", "landmark_network")}
"""What the filter has states for, by where the landmarks come from."""


@functools.cache
def scene(source: str = "geometric") -> Scene:
    """An estimate with a known attitude as after a prediction, with correlated errors."""
    with jax.ensure_compile_time_eval():
        params = nominal_parameters(scenario_loader.load("pose_inspection"))[1]
        assert params.flight.target is not None
        target = replace(params.flight.target, landmarks=jnp.asarray(LANDMARKS))
        r_TS_N = quaternion.rotate(quaternion.conjugate(jnp.asarray(Q_KN)), jnp.asarray(PLACE))
        states = relative_filter_state.states_with(SENSORS[source])
        made = relative_filter_state.initial(params.flight.navigation, r_TS_N, jnp.zeros(3), states, target)
        assert made.target is not None
        reference = replace(made.target, q_TN=jnp.asarray(Q_TN), known=jnp.ones((), dtype=bool))
        slow = {
            **made.slow,
            "bearing_bias": jnp.array([1e-3, -2e-3]),
            "body_offset": jnp.array([0.01, -0.02, 0.005]),
        }
        if "network_turn" in slow:
            slow |= {"network_turn": jnp.array([0.02, -0.03, 0.01]), "network_place": jnp.array([1e-3, -2e-3, 0.01])}
        covariance = random_covariance(np.random.default_rng(3), np.full(made.layout.size, 0.01))
        estimate = replace(made, target=reference, slow=slow, covariance=jnp.asarray(covariance))
        return Scene(params.flight.navigation, target, estimate)


def tangents_of(estimate: RelativeEstimate, vector: Array, landmarks: Array) -> Array:
    """Tangents (n, 2) of landmarks by the definition of the state, for another mean of it."""
    moved = relative_filter_state.moved_to(estimate, vector, estimate.covariance)
    assert moved.target is not None
    q_NT = quaternion.conjugate(target_attitude_ekf.attitude(moved.target, moved.slow))
    R_KN = quaternion.to_matrix(jnp.asarray(Q_KN))
    turned_N = (landmarks + moved.slow["body_offset"][None]) @ quaternion.to_matrix(q_NT).T
    places_K, place_K = turned_N @ R_KN.T, R_KN @ moved.r_TS_N
    if "network_turn" in moved.slow:
        # The network shows a target whose attitude is turned, the landmarks of which turn the other way in K.
        known, further = estimate.slow["network_turn"], moved.slow["network_turn"] - estimate.slow["network_turn"]
        turn = quaternion.to_matrix(quaternion.exp(-further)) @ quaternion.to_matrix(quaternion.exp(-known))
        places_K = places_K @ turn.T
        place_K = place_K + jnp.linalg.norm(estimate.r_TS_N) * moved.slow["network_place"]
    places_K = places_K + place_K[None]
    return places_K[:, :2] / places_K[:, 2:] + moved.slow["bearing_bias"][None]


def view_of(
    variance_of_attitude: float,
    moved: np.ndarray | float = 0.0,
    present: np.ndarray | None = None,
    source: str = "geometric",
) -> LandmarkView:
    """Picture in which landmarks are off by some random sigmas, and `moved` (n, 2) [-] besides."""
    _, _, estimate = scene(source)
    expected = np.asarray(tangents_of(estimate, estimate.vector, jnp.asarray(LANDMARKS)))
    sigma = SIGMA * np.linspace(0.7, 1.5, COUNT)
    noise = sigma[:, None] * np.random.default_rng(7).normal(size=(COUNT, 2))
    return LandmarkView(
        tangents=jnp.asarray(expected + noise + moved),
        variance=jnp.asarray(sigma**2),
        present=jnp.ones(COUNT, dtype=bool) if present is None else jnp.asarray(present),
        q_KN=jnp.asarray(Q_KN),
        attitude_variance=jnp.asarray(variance_of_attitude),
    )


@functools.partial(jax.jit, static_argnums=1)
def rows_of(view: LandmarkView, source: str = "geometric") -> MeasurementRows:
    return landmark_measurement.rows(*scene(source), view)


def dense(view: LandmarkView, source: str = "geometric") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Jacobian (2n, s) by automatic differentiation, residuals (2n,) and covariance of the noise (2n, 2n)."""
    _, _, estimate = scene(source)
    chosen = np.flatnonzero(np.asarray(view.present))
    landmarks = jnp.asarray(LANDMARKS[chosen])
    expected = tangents_of(estimate, estimate.vector, landmarks)
    jacobian = jax.jacfwd(lambda vector: tangents_of(estimate, vector, landmarks).ravel())(estimate.vector)
    residual = (np.asarray(view.tangents)[chosen] - np.asarray(expected)).ravel()
    common = float(view.attitude_variance) * np.kron(np.ones((len(chosen), len(chosen))), np.eye(2))
    return np.asarray(jacobian), residual, np.diag(np.repeat(np.asarray(view.variance)[chosen], 2)) + common


COMMON = {"no common error": TINY, "one like the noise": SIGMA**2, "a large one": (30.0 * SIGMA) ** 2}


@pytest.mark.parametrize("source", SENSORS)
@pytest.mark.parametrize("name", COMMON)
def test_eight_rows_have_the_information_of_all_landmarks(name: str, source: str) -> None:
    view = view_of(COMMON[name], source=source)
    H, y, R = dense(view, source)
    found = rows_of(view, source)
    J, values = np.asarray(found.jacobian), np.asarray(found.residual)
    assert J.shape == (8, scene(source).estimate.layout.size)
    np.testing.assert_array_equal(found.weight, 1.0)
    np.testing.assert_array_equal(found.variance, 1.0)
    expected = H.T @ np.linalg.solve(R, H)
    np.testing.assert_allclose(J.T @ J, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(J.T @ values, H.T @ np.linalg.solve(R, y), rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("name", COMMON)
def test_an_update_by_eight_rows_is_that_by_all_landmarks(name: str) -> None:
    view = view_of(COMMON[name])
    H, y, R = dense(view)
    P = np.asarray(scene().estimate.covariance)
    gain = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    found = jax.jit(kalman_update.update)(scene().estimate.covariance, rows_of(view))
    sigma = np.sqrt(np.diag(P))
    np.testing.assert_allclose(found.deviation / sigma, gain @ y / sigma, atol=1e-6)
    after = P - gain @ H @ P
    np.testing.assert_allclose(found.covariance / np.outer(sigma, sigma), after / np.outer(sigma, sigma), atol=1e-7)
    # It has told much: half of the variance of something, and a good part of a sigma.
    assert (np.diag(after) / np.diag(P)).min() < 0.5
    assert np.abs(gain @ y / sigma).max() > 0.1


def test_a_landmark_alone_gives_the_rows_that_it_has() -> None:
    view = view_of(SIGMA**2, present=np.arange(COUNT) == 4)
    H, y, R = dense(view)
    P = np.asarray(scene().estimate.covariance)
    gain = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    found = jax.jit(kalman_update.update)(scene().estimate.covariance, rows_of(view))
    np.testing.assert_allclose(found.deviation, gain @ y, atol=1e-7)
    np.testing.assert_allclose(found.covariance, P - gain @ H @ P, atol=1e-9)


@pytest.mark.parametrize("false", [[3], [0, 9], [1, 2, 5, 6, 8]])
def test_landmarks_out_of_place_are_left_out(false: list[int]) -> None:
    is_false = np.isin(np.arange(COUNT), false)
    moved = np.where(is_false[:, None], [0.3, -0.2], 0.0)
    found, expected = rows_of(view_of(SIGMA**2, moved)), rows_of(view_of(SIGMA**2, present=~is_false))
    np.testing.assert_array_equal(found.weight, 1.0)
    np.testing.assert_allclose(found.jacobian, expected.jacobian, rtol=1e-12)
    np.testing.assert_allclose(found.residual, expected.residual, rtol=1e-12)


def test_what_is_not_there_is_of_no_effect() -> None:
    present = np.arange(COUNT) != 2
    view = view_of(SIGMA**2, present=present)
    other = replace(view, tangents=view.tangents.at[2].set(jnp.nan))
    np.testing.assert_array_equal(rows_of(other).residual, rows_of(view).residual)
    np.testing.assert_array_equal(rows_of(other).jacobian, rows_of(view).jacobian)


@pytest.mark.parametrize("source", SENSORS)
def test_the_gate_of_a_landmark_is_that_of_the_tuning(source: str) -> None:
    _, _, estimate = scene(source)
    tuning = scene(source).tuning
    P, H = np.asarray(estimate.covariance), dense(view_of(SIGMA**2, source=source), source)[0][:2]
    S = H @ P @ H.T + (np.asarray(view_of(0.0).variance)[0] + SIGMA**2) * np.eye(2)
    expected = np.asarray(tangents_of(estimate, estimate.vector, jnp.asarray(LANDMARKS)))
    for share, is_used in ((0.99, True), (1.01, False)):
        # Along a direction of the residual's covariance, just within and beyond the gate.
        off = share * float(tuning.gate_sigma) * np.linalg.cholesky(S) @ np.array([0.6, 0.8])
        view = view_of(SIGMA**2, source=source)
        view = replace(view, tangents=view.tangents.at[0].set(expected[0] + off))
        without = rows_of(replace(view, present=view.present.at[0].set(False)), source)
        assert np.allclose(rows_of(view, source).jacobian, without.jacobian, rtol=1e-9) is not is_used


def test_no_row_counts_where_most_landmarks_are_elsewhere() -> None:
    is_false = np.arange(COUNT) < 6
    moved = np.where(is_false[:, None], [0.3, -0.2], 0.0)
    np.testing.assert_array_equal(rows_of(view_of(SIGMA**2, moved)).weight, 0.0)


def test_no_row_counts_without_an_attitude_or_a_landmark() -> None:
    tuning, target, estimate = scene()
    assert estimate.target is not None
    lost = replace(estimate, target=replace(estimate.target, known=jnp.zeros((), dtype=bool)))
    found = jax.jit(landmark_measurement.rows)(tuning, target, lost, view_of(SIGMA**2))
    np.testing.assert_array_equal(found.weight, 0.0)
    nothing = rows_of(view_of(SIGMA**2, present=np.zeros(COUNT, dtype=bool)))
    np.testing.assert_array_equal(nothing.weight, 0.0)
    assert np.isfinite(nothing.jacobian).all() and np.isfinite(nothing.residual).all()


def test_a_picture_is_what_was_measured_with_the_believed_noise() -> None:
    tuning, target, estimate = scene()
    vehicle = nominal_parameters(scenario_loader.load("pose_inspection"))[1].flight.vehicle
    q_BN = jnp.array([0.6, 0.8, 0.0, 0.0])
    view = SensorView(tuning=tuning, relative=estimate, q_BN=q_BN, time=jnp.zeros(()), vehicle=vehicle, target=target)
    measured = {
        "landmarks_right_tangent": jnp.array([0.1, jnp.nan]),
        "landmarks_down_tangent": jnp.array([0.2, jnp.nan]),
        "landmarks_sigma_tangent": jnp.array([2e-3, jnp.nan]),
    }
    found = landmark_measurement.picture({"believed_noise_factor": jnp.asarray(1.5)}, view, measured)
    assert found.present.tolist() == [True, False]
    np.testing.assert_allclose(found.tangents, [[0.1, 0.2], [0.0, 0.0]])
    np.testing.assert_allclose(found.variance, [9e-6, 2.25], rtol=1e-12)
    np.testing.assert_allclose(found.attitude_variance, float(tuning.attitude_sigma) ** 2)
    R_KN = quaternion.to_matrix(vehicle.camera_mounting) @ quaternion.to_matrix(q_BN)
    np.testing.assert_allclose(quaternion.to_matrix(found.q_KN), R_KN, atol=1e-12)
