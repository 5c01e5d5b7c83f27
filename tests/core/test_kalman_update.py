"""Sequential scalar updates against the textbook joint update."""

import jax
import numpy as np
from hypothesis import given
from numpy_reference import SEEDS, random_covariance
from scipy.stats import multivariate_normal

from rpojax.core import kalman_update
from rpojax.core.kalman_update import KalmanUpdate, MeasurementRows

STATES, ROWS = 7, 4
TEXTBOOK = 1e-10  # conditioning of the joint innovation covariance times rounding
EXACT = 1e-14  # a few roundings of numbers near one


@jax.jit
def update(covariance: jax.Array, *rows: jax.Array) -> KalmanUpdate:
    residual, jacobian, variance, weight = rows
    return kalman_update.update(
        covariance, MeasurementRows(residual=residual, jacobian=jacobian, variance=variance, weight=weight)
    )


def random_case(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    P = random_covariance(rng, 10.0 ** rng.uniform(-1, 1, STATES))
    return P, rng.normal(size=ROWS), rng.normal(size=(ROWS, STATES)), 10.0 ** rng.uniform(-2, 1, ROWS)


def joint_update(P: np.ndarray, z: np.ndarray, H: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    S = H @ P @ H.T + np.diag(R)
    K = np.linalg.solve(S, H @ P).T
    remaining = np.eye(STATES) - K @ H
    return K @ z, remaining @ P @ remaining.T + K @ np.diag(R) @ K.T


@given(SEEDS)
def test_sequential_rows_equal_the_joint_update(seed: int) -> None:
    P, z, H, R = random_case(seed)
    result = update(P, z, H, R, np.ones(ROWS))
    deviation, covariance = joint_update(P, z, H, R)
    np.testing.assert_allclose(result.deviation, deviation, atol=TEXTBOOK * np.max(np.abs(deviation)))
    np.testing.assert_allclose(result.covariance, covariance, atol=TEXTBOOK * np.max(np.abs(P)))


@given(SEEDS)
def test_the_order_of_the_rows_does_not_matter(seed: int) -> None:
    P, z, H, R = random_case(seed)
    order = np.random.default_rng(seed).permutation(ROWS)
    one = update(P, z, H, R, np.ones(ROWS))
    other = update(P, z[order], H[order], R[order], np.ones(ROWS))
    np.testing.assert_allclose(other.deviation, one.deviation, atol=TEXTBOOK * np.max(np.abs(one.deviation)))
    np.testing.assert_allclose(other.covariance, one.covariance, atol=TEXTBOOK * np.max(np.abs(P)))
    np.testing.assert_allclose(other.log_likelihood, one.log_likelihood, rtol=TEXTBOOK, atol=TEXTBOOK)


@given(SEEDS)
def test_the_log_likelihood_is_that_of_the_joint_innovation(seed: int) -> None:
    P, z, H, R = random_case(seed)
    expected = multivariate_normal.logpdf(z, cov=H @ P @ H.T + np.diag(R))
    np.testing.assert_allclose(update(P, z, H, R, np.ones(ROWS)).log_likelihood, expected, rtol=1e-9)


@given(SEEDS)
def test_rows_of_weight_zero_change_nothing_but_are_still_reported(seed: int) -> None:
    P, z, H, R = random_case(seed)
    weight = np.array([1.0, 0.0, 1.0, 0.0])
    used = weight > 0.0
    result = update(P, z, H, R, weight)
    np.testing.assert_array_equal(result.used, used)
    deviation, covariance = joint_update(P, z[used], H[used], R[used])
    np.testing.assert_allclose(result.deviation, deviation, atol=TEXTBOOK * np.max(np.abs(deviation)))
    np.testing.assert_allclose(result.covariance, covariance, atol=TEXTBOOK * np.max(np.abs(P)))
    expected = multivariate_normal.logpdf(z[used], cov=(H @ P @ H.T + np.diag(R))[np.ix_(used, used)])
    np.testing.assert_allclose(result.log_likelihood, expected, rtol=1e-9)
    after = H[3] @ covariance @ H[3] + R[3]
    np.testing.assert_allclose(result.innovation[3], z[3] - H[3] @ deviation, atol=TEXTBOOK * 10)
    np.testing.assert_allclose(result.innovation_variance[3], after, rtol=1e-9)


@given(SEEDS)
def test_the_covariance_stays_symmetric_and_positive_also_after_a_nearly_perfect_measurement(seed: int) -> None:
    P, z, H, _ = random_case(seed)
    after = np.asarray(update(P, z, H, np.full(ROWS, 1e-12), np.ones(ROWS)).covariance)
    scale = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    np.testing.assert_allclose(after / scale, after.T / scale, atol=EXACT)
    assert np.linalg.eigvalsh(after / scale)[0] > -EXACT
    assert np.all(np.diag(after) <= np.diag(P) * (1.0 + EXACT))


@given(SEEDS)
def test_the_first_innovation_is_the_residual_with_its_predicted_variance(seed: int) -> None:
    P, z, H, R = random_case(seed)
    result = update(P, z, H, R, np.ones(ROWS))
    assert result.innovation[0] == z[0]
    np.testing.assert_allclose(result.innovation_variance[0], H[0] @ P @ H[0] + R[0], rtol=1e-12)


@given(SEEDS)
def test_process_variance_is_added_before_the_rows_and_inflation_variance_after_them(seed: int) -> None:
    P, z, H, R = random_case(seed)
    process_variance, inflation_variance = np.random.default_rng(seed).uniform(0.0, 2.0, (2, STATES))
    rows = MeasurementRows(residual=z, jacobian=H, variance=R, weight=np.ones(ROWS))
    result = jax.jit(kalman_update.update)(
        P, rows, process_variance=process_variance, inflation_variance=inflation_variance
    )
    deviation, covariance = joint_update(P + np.diag(process_variance), z, H, R)
    np.testing.assert_allclose(result.deviation, deviation, atol=TEXTBOOK * np.max(np.abs(deviation)))
    expected = covariance + np.diag(inflation_variance)
    np.testing.assert_allclose(result.covariance, expected, atol=TEXTBOOK * np.max(np.abs(expected)))


@given(SEEDS)
def test_a_precomputed_product_of_jacobian_and_covariance_is_used(seed: int) -> None:
    P, z, H, R = random_case(seed)
    rows = MeasurementRows(residual=z, jacobian=H, variance=R, weight=np.ones(ROWS))
    known = jax.jit(kalman_update.update)(P, rows, HP=H @ P)
    expected = update(P, z, H, R, np.ones(ROWS))
    np.testing.assert_allclose(known.covariance, expected.covariance, atol=TEXTBOOK * np.max(np.abs(P)))
    np.testing.assert_allclose(known.deviation, expected.deviation, atol=TEXTBOOK * np.max(np.abs(expected.deviation)))


@given(SEEDS)
def test_a_weighted_row_equals_the_joseph_form_of_the_weighted_gain_in_value_and_derivative(seed: int) -> None:
    P, z, H, R = random_case(seed)

    def joseph(weight: jax.Array) -> jax.Array:
        gain = weight * P @ H[0] / (H[0] @ P @ H[0] + R[0])
        remaining = np.eye(STATES) - gain[:, None] * H[0][None, :]
        return remaining @ P @ remaining.T + R[0] * gain[:, None] * gain[None, :]

    def found(weight: jax.Array) -> jax.Array:
        return update(P, z[:1], H[:1], R[:1], weight[None]).covariance

    for weight in (0.0, 0.3, 1.0):
        scale = TEXTBOOK * np.max(np.abs(P))
        np.testing.assert_allclose(found(np.array(weight)), joseph(np.array(weight)), atol=scale)
        slopes = [jax.jacfwd(form)(np.array(weight)) for form in (found, joseph)]
        np.testing.assert_allclose(*slopes, atol=scale)


@given(SEEDS)
def test_a_part_of_the_covariance_is_what_its_sources_leave_after_the_gain(seed: int) -> None:
    P, z, H, R = random_case(seed)
    rng = np.random.default_rng(seed)
    share = rng.uniform(0.0, 1.0, STATES)
    part, noise = P * share[:, None] * share[None, :], R * rng.uniform(0.0, 1.0, ROWS)
    weight = np.array([1.0, 0.0, 1.0, 1.0])
    used = weight > 0.0
    S = H[used] @ P @ H[used].T + np.diag(R[used])
    K = np.linalg.solve(S, H[used] @ P).T
    remaining = np.eye(STATES) - K @ H[used]
    found, without_noise, after = parts_after(part, noise, P, z, H, R, weight)
    scale = TEXTBOOK * np.max(np.abs(P))
    np.testing.assert_allclose(without_noise, remaining @ part @ remaining.T, atol=scale)
    np.testing.assert_allclose(found - without_noise, K @ np.diag(noise[used]) @ K.T, atol=scale)
    np.testing.assert_allclose(after, joint_update(P, z[used], H[used], R[used])[1], atol=scale)


@jax.jit
def parts_after(
    part: jax.Array, noise: jax.Array, covariance: jax.Array, *of_rows: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Part after the rows with some of their noise and without, and the whole covariance."""
    residual, jacobian, variance, weight = of_rows
    rows = MeasurementRows(residual=residual, jacobian=jacobian, variance=variance, weight=weight)
    gains, after = kalman_update.reduced_by_rows(covariance, rows)
    with_noise = kalman_update.part_after(part, rows, gains, noise)
    return with_noise, kalman_update.part_after(part, rows, gains), after
