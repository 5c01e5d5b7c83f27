"""Attitude filter: consistency on a slew, comparison with the star tracker, and each step against the textbook."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy_reference import attitude_difference, random_covariance, random_unit

from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.flight.navigation import attitude_ekf
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.scenario.params import Params
from rpojax.sensors import gyro, star_tracker

RUNS, SECONDS, SUBSTEPS, FINE = 200, 120, 5, 4
STEP = 1.0 / SUBSTEPS

update = jax.jit(attitude_ekf.update)
integrate_gyro = jax.jit(attitude_ekf.integrate_gyro, static_argnums=2)
predict_covariance = jax.jit(attitude_ekf.predict_covariance, static_argnums=3)


def rate(t: jax.Array) -> jax.Array:
    """A slew of one radian about a skew axis in the second half minute, on top of a slow turn [rad/s]."""
    slewing = (t > 30.0) & (t < 60.0)
    profile = jnp.where(slewing, (1.0 - jnp.cos(2.0 * jnp.pi * (t - 30.0) / 30.0)) / 30.0, 0.0)
    return profile * jnp.array([0.6, 0.64, 0.48]) + jnp.array([0.0, 0.0, 1.1e-3])


@jax.jit
def errors(params: Params, key: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Error of attitude and bias (runs, seconds, 6) right after each update, and its NEES (runs, seconds)."""
    tuning = params.flight.attitude_filter

    def run(key: jax.Array) -> tuple[jax.Array, jax.Array]:
        start_key, star_key, gyro_key = jax.random.split(key, 3)
        first = jax.random.normal(start_key, (9,))
        bias = params.gyro.initial_bias_sigma * first[:3]
        q = jnp.array([1.0, 0.0, 0.0, 0.0])
        estimate = attitude_ekf.initial(
            tuning,
            star_tracker.measure(params.star_tracker, q, first[3:6]),
            gyro.measure(params.gyro, rate(jnp.zeros(())), bias, first[6:], STEP),
        )

        def substep(
            carry: tuple[jax.Array, AttitudeEstimate], inputs: tuple[jax.Array, jax.Array]
        ) -> tuple[tuple[jax.Array, AttitudeEstimate], None]:
            q, estimate = carry
            t, normals = inputs
            middles = t + STEP * (jnp.arange(FINE, dtype=jnp.float64) + 0.5) / FINE
            # The truth is integrated in finer steps than the filter.
            q, _ = jax.lax.scan(lambda q, at: (quaternion.propagate(q, rate(at), STEP / FINE), None), q, middles)
            sample = gyro.measure(params.gyro, rate(t + STEP), bias, normals, STEP)
            return (q, attitude_ekf.integrate_gyro(estimate, sample, STEP)), None

        def second(
            carry: tuple[jax.Array, AttitudeEstimate], inputs: tuple[jax.Array, jax.Array, jax.Array]
        ) -> tuple[tuple[jax.Array, AttitudeEstimate], tuple[jax.Array, jax.Array]]:
            q, estimate = carry
            t, star_normals, gyro_normals = inputs
            q_before = estimate.q_BN
            times = t + STEP * jnp.arange(SUBSTEPS, dtype=jnp.float64)
            (q, estimate), _ = jax.lax.scan(substep, (q, estimate), (times, gyro_normals))
            estimate = attitude_ekf.predict_covariance(tuning, estimate, q_before, 1.0)
            measured = star_tracker.measure(params.star_tracker, q, star_normals)
            estimate = attitude_ekf.update(tuning, estimate, measured, jnp.asarray(True))
            turn = quaternion.log(quaternion.multiply(q, quaternion.conjugate(estimate.q_BN)))
            error = jnp.concatenate([turn, bias - estimate.bias_B])
            nees = jnp.sum(error * jnp.linalg.solve(estimate.covariance, error))
            return (q, estimate), (error, nees)

        inputs = (
            jnp.arange(SECONDS, dtype=jnp.float64),
            jax.random.normal(star_key, (SECONDS, 3)),
            jax.random.normal(gyro_key, (SECONDS, SUBSTEPS, 3)),
        )
        return jax.lax.scan(second, (q, estimate), inputs)[1]

    return jax.vmap(run)(jax.random.split(key, RUNS))


@pytest.fixture(scope="module")
def history(params: Params) -> tuple[np.ndarray, np.ndarray]:
    found = errors(params, jax.random.key(1))
    return np.asarray(found[0]), np.asarray(found[1])


def test_nees_is_consistent_before_during_and_after_a_slew(
    history: tuple[np.ndarray, np.ndarray],
) -> None:
    _, nees = history
    for second in (5, 29, 45, 60, 119):
        # The mean of 200 chi-square numbers with 6 degrees of freedom, to four sigma.
        assert abs(nees[:, second].mean() - 6.0) < 4.0 * np.sqrt(2.0 * 6.0 / RUNS), second


def test_the_estimate_is_unbiased_and_better_than_the_star_tracker(
    history: tuple[np.ndarray, np.ndarray],
) -> None:
    final = history[0][:, -1]
    spread = final.std(axis=0)
    assert np.all(np.abs(final.mean(axis=0)) < 4.0 * spread / np.sqrt(RUNS))
    assert np.all(spread[:3] < np.deg2rad([0.01, 0.003, 0.003]) * [0.7, 0.9, 0.9])
    assert np.all(spread[3:] < 0.5 * np.deg2rad(0.003))  # a bias of 0.003 deg/s at the start is mostly found


def test_the_predicted_covariance_agrees_with_the_propagated_error(params: Params) -> None:
    rng = np.random.default_rng(2)
    sigma = np.concatenate([np.full(3, 1e-4), np.full(3, 3e-5)])
    P = random_covariance(rng, sigma)
    rate_B, bias_B = np.array([0.005, -0.004, 0.006]), np.array([1e-5, 0.0, -1e-5])
    tuning = params.flight.attitude_filter
    before = AttitudeEstimate(
        q_BN=random_unit(rng, 4), omega_BN_B=rate_B - bias_B, bias_B=bias_B, gyro_B=rate_B, covariance=P
    )

    @jax.jit
    @jax.jacfwd
    def transition(error: jax.Array) -> jax.Array:
        """Error (attitude, bias) one second later, of a truth that differs from the estimate by `error` now."""
        q_true = quaternion.multiply(quaternion.exp(error[:3]), jnp.asarray(before.q_BN))
        q_true = quaternion.propagate(q_true, rate_B - bias_B - error[3:], 1.0)
        q_known = quaternion.propagate(jnp.asarray(before.q_BN), jnp.asarray(rate_B - bias_B), 1.0)
        return jnp.concatenate([quaternion.log(quaternion.multiply(q_true, quaternion.conjugate(q_known))), error[3:]])

    F = np.asarray(transition(jnp.zeros(6)))
    noise = np.repeat([np.deg2rad(0.0025) ** 2, np.deg2rad(1e-5) ** 2], 3)
    expected = F @ P @ F.T + np.diag(noise)
    carried = integrate_gyro(before, rate_B, 1.0)
    found = np.asarray(predict_covariance(tuning, carried, before.q_BN, 1.0).covariance)
    units = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    # The bias is taken to act at the end of the second: half of the second's rotation of 9 mrad is neglected.
    np.testing.assert_allclose(found / units, expected / units, atol=0.005)
    np.testing.assert_allclose(found[3:, 3:] / units[3:, 3:], expected[3:, 3:] / units[3:, 3:], atol=1e-12)


def test_the_update_agrees_with_the_textbook(params: Params) -> None:
    rng = np.random.default_rng(3)
    sigma = np.concatenate([np.full(3, 2e-4), np.full(3, 5e-5)])
    P = random_covariance(rng, sigma)
    q, gyro_B, bias_B = random_unit(rng, 4), 0.01 * rng.normal(size=3), 1e-5 * rng.normal(size=3)
    before = AttitudeEstimate(q_BN=q, omega_BN_B=gyro_B - bias_B, bias_B=bias_B, gyro_B=gyro_B, covariance=P)
    turn = 1e-4 * rng.normal(size=3)
    measured = quaternion.multiply(quaternion.exp(jnp.asarray(turn)), jnp.asarray(q))
    after = update(params.flight.attitude_filter, before, measured, True)
    H = np.eye(3, 6)
    S = P[:3, :3] + np.diag(np.deg2rad([0.01, 0.003, 0.003]) ** 2)
    K = np.linalg.solve(S, H @ P).T
    x = K @ turn
    expected_q = quaternion.multiply(quaternion.exp(jnp.asarray(x[:3])), jnp.asarray(q))
    assert attitude_difference(np.asarray(after.q_BN), np.asarray(expected_q)) < 1e-14
    np.testing.assert_allclose(after.bias_B, bias_B + x[3:], atol=1e-14)
    np.testing.assert_allclose(after.omega_BN_B, gyro_B - bias_B - x[3:], atol=1e-14)
    units = np.outer(sigma, sigma)
    np.testing.assert_allclose(np.asarray(after.covariance) / units, (P - K @ S @ K.T) / units, atol=1e-10)


def test_the_attitude_is_integrated_with_the_mean_of_two_samples_less_the_bias(params: Params) -> None:
    zero = jnp.zeros(3)
    before = attitude_ekf.initial(params.flight.attitude_filter, jnp.array([1.0, 0.0, 0.0, 0.0]), zero)
    before = replace(before, bias_B=jnp.array([0.0, 0.0, 0.1]))
    after = integrate_gyro(before, np.array([0.0, 0.0, 0.6]), 0.2)
    angle = (0.3 - 0.1) * 0.2
    np.testing.assert_allclose(after.q_BN, [np.cos(angle / 2), 0.0, 0.0, -np.sin(angle / 2)], atol=1e-15)
    np.testing.assert_allclose(after.omega_BN_B, [0.0, 0.0, 0.5], rtol=1e-15)


def test_without_the_star_tracker_the_attitude_covariance_grows(params: Params) -> None:
    tuning = params.flight.attitude_filter
    rate_B = np.array([0.0, 0.0, 1.1e-3])
    wrong = random_unit(np.random.default_rng(4), 4)  # output of an unavailable star tracker
    blind = attitude_ekf.initial(tuning, jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.asarray(rate_B))
    sigmas = [float(np.sqrt(blind.covariance[0, 0]))]
    for _ in range(100):
        q_before = blind.q_BN
        blind = integrate_gyro(blind, rate_B, 1.0)
        blind = predict_covariance(tuning, blind, q_before, 1.0)
        blind = update(tuning, blind, wrong, False)
        sigmas.append(float(np.sqrt(blind.covariance[0, 0])))
    expected = np.array([np.cos(0.055), 0.0, 0.0, -np.sin(0.055)])  # 1.1 mrad/s for 100 s
    assert attitude_difference(np.asarray(blind.q_BN), expected) < 1e-12
    assert np.all(np.diff(sigmas) > 0.0)
    # 0.01 deg at the start; 0.003 deg/s of unknown bias make 0.3 deg; the random walk 0.025 deg.
    np.testing.assert_allclose(sigmas[-1], np.deg2rad(np.sqrt(0.01**2 + 0.3**2 + 0.025**2)), rtol=0.01)
