"""Split covariance intersection against formulas with matrix inverses."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from rpojax.flight.cooperation import covariance_intersection
from rpojax.flight.cooperation.covariance_intersection import SplitEstimate


def covariance(rng: np.random.Generator, size: int) -> np.ndarray:
    root = rng.normal(size=(size, size)) * np.exp(rng.normal(size=size))
    return root @ root.T + 1e-3 * np.eye(size)


def split(mean: np.ndarray, correlated: np.ndarray, independent: np.ndarray) -> SplitEstimate:
    return SplitEstimate(
        mean=jnp.asarray(mean), correlated=jnp.asarray(correlated), independent=jnp.asarray(independent)
    )


def test_independent_fusion_is_that_of_information() -> None:
    rng = np.random.default_rng(3)
    P, Q = covariance(rng, 12), covariance(rng, 6)
    x, z = rng.normal(size=12), rng.normal(size=6)
    H = np.eye(6, 12)
    mean, fused = covariance_intersection.independent_fusion(*map(jnp.asarray, (x, P, z, Q)), jnp.asarray(True))
    expected = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.inv(Q) @ H)
    np.testing.assert_allclose(fused, expected, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(mean, expected @ (np.linalg.inv(P) @ x + H.T @ np.linalg.inv(Q) @ z), rtol=1e-6)


def test_an_estimate_that_is_not_used_hardly_changes_anything() -> None:
    rng = np.random.default_rng(3)
    P, Q = covariance(rng, 6), covariance(rng, 6)
    own = split(np.arange(6.0), P, np.zeros((6, 6)))
    other = split(np.zeros(6), Q, np.zeros((6, 6)))
    mean, fused = covariance_intersection.fuse(own, [other], jnp.asarray([False]))
    np.testing.assert_array_equal(mean, own.mean)
    # Its share is a thousandth.
    np.testing.assert_allclose(fused, P / 0.999, rtol=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_covariance_bounds_the_error_whatever_the_correlation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    correlated = [covariance(rng, 6) for _ in range(3)]
    independent = [0.3 * covariance(rng, 6) for _ in range(3)]
    estimates = [split(rng.normal(size=6), C, D) for C, D in zip(correlated, independent, strict=True)]
    used = jnp.asarray([True, True])
    mean, fused = covariance_intersection.fuse(estimates[0], estimates[1:], used)
    shares = [float(share) for share in covariance_intersection.best_shares(estimates[0], estimates[1:], used)]
    assert sum(shares) == pytest.approx(1.0)
    information = [np.linalg.inv(C / w + D) for C, D, w in zip(correlated, independent, shares, strict=True)]
    expected = np.linalg.inv(sum(information))
    np.testing.assert_allclose(fused, expected, rtol=1e-6, atol=1e-9)
    gains = [expected @ each for each in information]
    np.testing.assert_allclose(
        mean, sum(K @ np.asarray(e.mean) for K, e in zip(gains, estimates, strict=True)), rtol=1e-6, atol=1e-9
    )
    # Correlated parts that come from the same unknowns, as correlated as they can be, in random directions.
    roots = [np.linalg.cholesky(C) for C in correlated]
    turns = [np.linalg.qr(rng.normal(size=(6, 6)))[0] for _ in range(3)]
    total = sum(K @ root @ turn for K, root, turn in zip(gains, roots, turns, strict=True))
    actual = total @ total.T + sum(K @ D @ K.T for K, D in zip(gains, independent, strict=True))
    assert np.linalg.eigvalsh(np.asarray(fused) - actual).min() > -1e-9 * np.trace(actual)


@pytest.mark.parametrize("case", range(6))
def test_share_makes_the_determinant_least(case: int) -> None:
    rng = np.random.default_rng(3)
    A, B, D = covariance(rng, 3), covariance(rng, 3), 0.1 * covariance(rng, 3)
    if case == 0:
        B = 1e6 * A
    if case == 1:
        A, D = 1e6 * B, 0.0 * D

    def volume(w: float) -> float:
        return -np.linalg.slogdet(np.linalg.inv(A / w + D) + np.linalg.inv(B / (1 - w)))[1]

    least = minimize_scalar(volume, bounds=(0.001, 0.999), method="bounded").fun
    own, other = split(np.zeros(3), A, D), split(np.zeros(3), B, np.zeros((3, 3)))
    share = float(covariance_intersection.best_shares(own, [other], jnp.asarray([True]))[0])
    # A share that is wrong by the width of the search costs a few per cent of a volume at most.
    assert volume(share) < least + 0.05
    if case < 2:
        assert abs(share - [1.0, 0.0][case]) < 0.05
