"""Weighted fit of a Gaussian mixture by expectation and maximisation, with regularised covariances."""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

_ITERATIONS = 40
_CONVERGED = 1e-3
_PRIOR_VARIANCE, _PRIOR_VARIANCE_MANY = 0.1, 0.5
"""Variance of the prior of covariances, in up to `_FEW` dimensions and in more, where most directions are nominal."""
_FEW = 3
_LOG_2PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True)
class GaussianMixture:
    """A Gaussian mixture.

    Attributes:
        weights: (components,) with sum 1
        means: (components, r)
        covariances: (components, r, r)
    """

    weights: np.ndarray
    means: np.ndarray
    covariances: np.ndarray


def fit(rng: np.random.Generator, y: np.ndarray, weights: np.ndarray, components: int) -> GaussianMixture:
    """Mixture of so many components for points (n, r) with weights (n,) of sum 1."""
    effective = 1.0 / float(np.sum(weights**2))
    means = _spread_starts(rng, y, weights, components)
    distances = np.stack([np.sum((y - mean) ** 2, axis=1) for mean in means])
    shares = np.eye(components)[np.argmin(distances, axis=0)]
    found, before = _maximise(y, weights, shares, effective), -np.inf
    for _ in range(_ITERATIONS):
        logs = component_logs(found, y)
        totals = np.asarray(logsumexp(logs, axis=1))
        likelihood = float(np.sum(weights * totals))
        found = _maximise(y, weights, np.exp(logs - totals[:, None]), effective)
        if likelihood - before < _CONVERGED:
            break
        before = likelihood
    return found


def component_logs(found: GaussianMixture, y: np.ndarray) -> np.ndarray:
    """Logarithms (n, components) of weight times density at points (n, r)."""
    columns = []
    for weight, mean, covariance in zip(found.weights, found.means, found.covariances, strict=True):
        factor = np.linalg.cholesky(covariance)
        whitened = np.linalg.solve(factor, (y - mean).T)
        determinant = np.log(np.diag(factor)).sum()
        columns.append(np.log(weight) - determinant - 0.5 * np.sum(whitened**2, axis=0) - 0.5 * y.shape[1] * _LOG_2PI)
    return np.stack(columns, axis=1)


def _spread_starts(rng: np.random.Generator, y: np.ndarray, weights: np.ndarray, count: int) -> np.ndarray:
    """Means (count, r) far from each other (k-means++; Arthur and Vassilvitskii 2007)."""
    rows = [rng.choice(len(y), p=weights)]
    distances = np.sum((y - y[rows[0]]) ** 2, axis=1)
    for _ in range(count - 1):
        chances = weights * distances
        total = chances.sum()
        rows.append(int(rng.choice(len(y), p=chances / total)) if total > 0.0 else rows[0])
        distances = np.minimum(distances, np.sum((y - y[rows[-1]]) ** 2, axis=1))
    return y[np.array(rows)]


def _maximise(y: np.ndarray, weights: np.ndarray, shares: np.ndarray, effective: float) -> GaussianMixture:
    """Mixture from the probabilities (n, components) that points belong to each; a prior keeps covariances regular."""
    size = y.shape[1]
    joint = weights[:, None] * shares
    totals = np.maximum(joint.sum(axis=0), 1e-12)
    means = (joint.T @ y) / totals[:, None]
    covariances = np.empty((len(totals), size, size))
    prior, variance = size + 2.0, _PRIOR_VARIANCE if size <= _FEW else _PRIOR_VARIANCE_MANY
    for k, total in enumerate(totals):
        offset = y - means[k]
        scatter = effective * offset.T @ (offset * joint[:, k].reshape(-1, 1))
        covariances[k] = (scatter + prior * variance * np.eye(size)) / (effective * total + prior)
    return GaussianMixture(totals / totals.sum(), means, covariances)
