"""Servicer orbit filter against the textbook."""

import jax
import numpy as np
from hypothesis import given
from numpy_reference import SEEDS, random_covariance
from rendezvous_scene import R_SN_N, V_SN_N

from rpojax.core.kalman_update import KalmanUpdate
from rpojax.flight.navigation import servicer_orbit_ekf
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import GpsMeasurement
from rpojax.flight.navigation.servicer_orbit_ekf import ServicerEstimate
from rpojax.scenario.params import Params

TEXTBOOK = 1e-10  # conditioning of the joint innovation covariance times rounding
YES, NO = np.asarray(True), np.asarray(False)
SIGMA = np.repeat([2.0, 0.02, 1.2], 3)


@jax.jit
def update(
    tuning: OrbitFilterTuning, estimate: ServicerEstimate, gps_N: jax.Array, present: jax.Array
) -> tuple[ServicerEstimate, KalmanUpdate]:
    return servicer_orbit_ekf.update(tuning, estimate, GpsMeasurement(position_N=gps_N, present=present))


def test_the_initial_estimate_has_the_tuned_standard_deviations(params: Params) -> None:
    estimate = servicer_orbit_ekf.initial(params.flight.navigation, *map(jax.numpy.asarray, (R_SN_N, V_SN_N)))
    np.testing.assert_allclose(estimate.covariance, np.diag(SIGMA**2))
    np.testing.assert_array_equal(estimate.gps_error_N, np.zeros(3))
    np.testing.assert_array_equal(estimate.r_SN_N, R_SN_N)
    np.testing.assert_array_equal(estimate.v_SN_N, V_SN_N)


@given(SEEDS)
def test_the_gps_update_agrees_with_the_textbook(params: Params, seed: int) -> None:
    rng = np.random.default_rng(seed)
    P = random_covariance(rng, SIGMA)
    gps_error = rng.normal(size=3)
    gps_N = R_SN_N + 3.0 * rng.normal(size=3)
    before = ServicerEstimate(r_SN_N=R_SN_N, v_SN_N=V_SN_N, gps_error_N=gps_error, covariance=P)
    after, result = update(params.flight.navigation, before, gps_N, YES)
    H = np.concatenate([np.eye(3), np.zeros((3, 3)), np.eye(3)], axis=1)
    S = H @ P @ H.T + 2.0**2 * np.eye(3)
    K = np.linalg.solve(S, H @ P).T
    x = K @ (gps_N - R_SN_N - gps_error)
    # The position's own rounding at 7000 km, 1e-9 m, limits what a correction of it can show.
    np.testing.assert_allclose(after.r_SN_N - R_SN_N, x[:3], atol=4e-9)
    np.testing.assert_allclose(after.v_SN_N - V_SN_N, x[3:6], atol=4e-12)
    np.testing.assert_allclose(after.gps_error_N - gps_error, x[6:], atol=4e-9)
    scale = np.outer(SIGMA, SIGMA)
    np.testing.assert_allclose(np.asarray(after.covariance) / scale, (P - K @ S @ K.T) / scale, atol=TEXTBOOK)
    np.testing.assert_allclose(result.innovation[0], (gps_N - R_SN_N - gps_error)[0], atol=4e-9)


def test_the_position_sigma_is_bounded_by_the_slow_gps_error(params: Params) -> None:
    estimate = servicer_orbit_ekf.initial(params.flight.navigation, *map(jax.numpy.asarray, (R_SN_N, V_SN_N)))
    for _ in range(200):  # without propagation the white noise averages out and the slow error stays
        estimate, _ = update(params.flight.navigation, estimate, R_SN_N, YES)
    sigma = np.sqrt(np.diag(np.asarray(estimate.covariance)))[:3]
    floor = 1.0 / np.sqrt(1.0 / 2.0**2 + 1.0 / (1.2**2 + 2.0**2 / 200))  # prior and one measurement of 1.2 m
    np.testing.assert_allclose(sigma, floor, rtol=1e-9)


def test_an_absent_gps_position_changes_nothing(params: Params) -> None:
    rng = np.random.default_rng(1)
    P = random_covariance(rng, SIGMA)
    before = ServicerEstimate(r_SN_N=R_SN_N, v_SN_N=V_SN_N, gps_error_N=rng.normal(size=3), covariance=P)
    after, result = update(params.flight.navigation, before, R_SN_N + 1e6, NO)
    jax.tree.map(np.testing.assert_array_equal, after, before)
    assert result.log_likelihood == 0.0
