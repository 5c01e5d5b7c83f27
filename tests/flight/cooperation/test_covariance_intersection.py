"""Split covariance intersection against formulas with matrix inverses."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from rpojax.flight.cooperation import covariance_intersection
from rpojax.flight.cooperation.covariance_intersection import SplitEstimate

RNG = np.random.default_rng(3)


def covariance(size: int) -> np.ndarray:
    root = RNG.normal(size=(size, size)) * np.exp(RNG.normal(size=size))
    return root @ root.T + 1e-3 * np.eye(size)


def test_independent_fusion_is_that_of_information() -> None:
    P, Q = covariance(12), covariance(6)
    x, z = RNG.normal(size=12), RNG.normal(size=6)
    H = np.eye(6, 12)
    mean, fused = covariance_intersection.independent_fusion(*map(jnp.asarray, (x, P, z, Q)), jnp.asarray(True))
    expected = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.inv(Q) @ H)
    np.testing.assert_allclose(fused, expected, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(mean, expected @ (np.linalg.inv(P) @ x + H.T @ np.linalg.inv(Q) @ z), rtol=1e-6)


def test_an_estimate_that_is_not_used_changes_nothing() -> None:
    P, Q = covariance(6), covariance(6)
    own = SplitEstimate(mean=jnp.arange(6.0), correlated=jnp.asarray(P), independent=jnp.zeros((6, 6)))
    other = SplitEstimate(mean=jnp.zeros(6), correlated=jnp.asarray(Q), independent=jnp.zeros((6, 6)))
    mean, fused = covariance_intersection.fuse(own, other, jnp.asarray(False), jnp.asarray(0.5))
    np.testing.assert_array_equal(mean, own.mean)
    np.testing.assert_array_equal(fused, P)


@pytest.mark.parametrize("correlation", [-0.95, 0.0, 0.5, 0.999])
def test_covariance_bounds_the_error_whatever_the_correlation(correlation: float) -> None:
    P, Q, baseline = covariance(6), covariance(6), 0.1 * covariance(6)
    weight = 0.3
    own = SplitEstimate(mean=jnp.zeros(6), correlated=jnp.asarray(P), independent=jnp.zeros((6, 6)))
    other = SplitEstimate(mean=jnp.ones(6), correlated=jnp.asarray(Q), independent=jnp.asarray(baseline))
    mean, fused = covariance_intersection.fuse(own, other, jnp.asarray(True), jnp.asarray(weight))
    total, other_total = P / weight, Q / (1 - weight) + baseline
    gain = total @ np.linalg.inv(total + other_total)
    np.testing.assert_allclose(mean, gain @ np.ones(6), rtol=1e-6, atol=1e-9)
    cross = correlation * np.linalg.cholesky(P) @ np.linalg.cholesky(Q).T
    keep = np.eye(6) - gain
    actual = keep @ P @ keep.T + gain @ (Q + baseline) @ gain.T + keep @ cross @ gain.T + gain @ cross.T @ keep.T
    assert np.linalg.eigvalsh(np.asarray(fused) - actual).min() > -1e-9 * np.trace(actual)


@pytest.mark.parametrize("case", range(6))
def test_weight_makes_the_determinant_least(case: int) -> None:
    A, B = covariance(3), covariance(3)
    if case == 0:
        B = 1e4 * A
    if case == 1:
        A = 1e4 * B
    found = minimize_scalar(
        lambda w: -np.linalg.slogdet(w * np.linalg.inv(A) + (1 - w) * np.linalg.inv(B))[1],
        bounds=(0.0, 1.0),
        method="bounded",
    ).x
    weight = covariance_intersection.best_weight(jnp.asarray(A), jnp.asarray(B))
    assert weight == pytest.approx(found, abs=1e-3)
    if case < 2:
        assert weight == [1.0, 0.0][case]
