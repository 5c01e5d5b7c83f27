"""Proposal of importance sampling fitted to weighted failures: the closest to the optimal one in cross-entropy.

The candidates are Gaussian mixtures in the subspace in which failures differ from the nominal distribution, with
several numbers of components, and a radial law. The one with the greatest likelihood on failures that were left out of
its fit is chosen (cross-validation).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from rpojax.analysis.reliability.rare_events.proposal_densities import (
    Density,
    Mixture,
    RadialDensity,
    SubspaceGaussian,
    mixture,
)

_ITERATIONS = 40
_CONVERGED = 1e-3
_PRIOR_VARIANCE, _PRIOR_VARIANCE_MANY = 0.1, 0.5
"""Variance of the prior of covariances, in up to `_FEW` dimensions and in more, where most directions are nominal."""
_FEW = 3
_LOG_2PI = float(np.log(2.0 * np.pi))
_SMALL_DIMENSION = 6
"""Dimension up to which the subspace is the whole space."""
_WHOLE_SPACE_DIMENSION = 20
"""Dimension up to which the whole space is a candidate."""
_MAX_SUBSPACE = 10
_COMPONENTS = (1, 2, 3, 4, 6, 8, 12)
_POINTS_PER_NUMBER = 3.0
"""Failures for each number of a component's mean and scale."""
_PATIENCE = 2
"""Numbers of components in a row that are no better before the search ends."""
_MAX_POINTS = 1200
_FOLDS = 2
_MIN_FOLD = 4
"""Failures of a fold below which one Gaussian, or in many dimensions the radial law, is taken without comparison."""
_INDEPENDENT = 0.1
"""Part of a direction outside of a subspace above which it is added to it."""
_WIDENED = 1.25
"""Factor on fitted variances: the proposal is to have heavier tails than the failures."""
_FITTED_SHARE, _WIDE_SHARE, _RADIAL_SHARE, _NOMINAL_SHARE = 0.65, 0.2, 0.1, 0.05


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
    """Mixture of `components` components for points (n, r) with weights (n,) of sum 1."""
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


@dataclass(frozen=True)
class WeightedFailures:
    """Points of failure that stand for the nominal distribution restricted to failure.

    Attributes:
        x: (n, k)
        weights: (n,) positive
        groups: (n,) equal for points that depend on each other, such as those of one chain
        steepest: (k,) unit vector of the regression of margins on points near failure; None where it is not known
    """

    x: np.ndarray
    weights: np.ndarray
    groups: np.ndarray
    steepest: np.ndarray | None = None

    @property
    def effective_size(self) -> float:
        """Independent failures of equal weight that would tell as much."""
        each = np.bincount(np.unique(self.groups, return_inverse=True)[1], weights=self.weights)
        return float(each.sum() ** 2 / np.sum(each**2))


def fit_proposal(rng: np.random.Generator, failures: WeightedFailures) -> Mixture:
    """Proposal for weighted failures, with a nominal and a wide part that bound its weights."""
    x, weights, groups = _thinned(rng, failures)
    folds = _folds(rng, groups)
    if min(int((folds == fold).sum()) for fold in range(_FOLDS)) < _MIN_FOLD:
        dimension = x.shape[1]
        return _assembled(rng, x, weights, np.eye(dimension) if dimension <= _WHOLE_SPACE_DIMENSION else None, 1)
    best: tuple[float, tuple[np.ndarray | None, int]] | None = None
    for basis in _bases(x, weights, failures):
        best_here, worse = -np.inf, 0
        for components in _component_counts(len(x), 0 if basis is None else basis.shape[1]):
            likelihood = 0.0
            for fold in range(_FOLDS):
                inside = folds != fold
                density = _assembled(rng, x[inside], weights[inside] / weights[inside].sum(), basis, components)
                likelihood += float(np.sum(weights[~inside] * density.log_density(x[~inside])))
            if best is None or likelihood > best[0]:
                best = (likelihood, (basis, components))
            worse = worse + 1 if likelihood < best_here else 0
            best_here = max(best_here, likelihood)
            if worse == _PATIENCE:
                break
    assert best is not None
    return _assembled(rng, x, weights, *best[1])


def _thinned(rng: np.random.Generator, failures: WeightedFailures) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, weights of sum 1 and groups; of many points a random part."""
    x, weights, groups = failures.x, failures.weights / failures.weights.sum(), failures.groups
    if len(x) > _MAX_POINTS:
        rows = rng.choice(len(x), _MAX_POINTS, p=weights)
        return x[rows], np.full(_MAX_POINTS, 1.0 / _MAX_POINTS), groups[rows]
    return x, weights, groups


def _folds(rng: np.random.Generator, groups: np.ndarray) -> np.ndarray:
    """Fold (n,) of each point; points of a group share a fold."""
    names, places = np.unique(groups, return_inverse=True)
    if len(names) < _FOLDS:
        return np.arange(len(groups)) % _FOLDS
    return (rng.permutation(len(names)) % _FOLDS)[places]


def _component_counts(points: int, size: int) -> tuple[int, ...]:
    """Numbers of components that `points` failures can tell apart; only 1 without a subspace."""
    if size == 0:
        return (1,)
    return tuple(k for k in _COMPONENTS if k == 1 or k * (size + 1) * _POINTS_PER_NUMBER <= points)


def _bases(x: np.ndarray, weights: np.ndarray, failures: WeightedFailures) -> list[np.ndarray | None]:
    """Candidates for the subspace, (k, r) each; None stands for the radial law."""
    dimension = x.shape[1]
    bases: list[np.ndarray | None] = [None]
    if dimension <= _WHOLE_SPACE_DIMENSION:
        bases.append(np.eye(dimension))
    if dimension > _SMALL_DIMENSION:
        found = _informative_subspace(x, weights, failures.effective_size)
        if failures.steepest is not None:
            along = failures.steepest[:, None]
            bases.append(along)
            if found.shape[1] > 0:
                rest, sizes, _ = np.linalg.svd(found - along @ (along.T @ found), full_matrices=False)
                bases.append(np.linalg.qr(np.hstack([along, rest[:, sizes > _INDEPENDENT]]))[0])
        bases += [found] if found.shape[1] > 0 else []
        bases += [found[:, :1]] if found.shape[1] > 1 else []
    return bases


def _informative_subspace(x: np.ndarray, weights: np.ndarray, effective: float) -> np.ndarray:
    """Directions (k, r) along which the second moment of failures differs from 1 by more than sampling explains.

    The bounds are those of eigenvalues of a sample covariance of `effective` independent points (Marchenko and Pastur
    1967); the largest information comes first.
    """
    values, vectors = np.linalg.eigh((weights[:, None] * x).T @ x)
    ratio = np.sqrt(x.shape[1] / max(effective, 1.0))
    above = values > (1.0 + ratio) ** 2
    below = (values < (1.0 - ratio) ** 2) if ratio < 1.0 else np.zeros_like(above)
    values = np.maximum(values, 1e-9)
    information = np.where(above | below, values - 1.0 - np.log(values), -1.0)
    most = int(min(_MAX_SUBSPACE, max(1.0, effective / 8.0)))
    order = np.argsort(-information)[:most]
    return vectors[:, order[information[order] > 0.0]]


def _assembled(
    rng: np.random.Generator, x: np.ndarray, weights: np.ndarray, basis: np.ndarray | None, components: int
) -> Mixture:
    """Proposal for failures: fitted components, the same ones at least as wide as the nominal, radial and nominal."""
    dimension = x.shape[1]
    radial = _radial(x, weights)
    nominal = _gaussian(np.eye(dimension), np.zeros(dimension), np.eye(dimension))
    if basis is None:
        wide = RadialDensity(dimension, max(0.5 * radial.shape, 0.5 * dimension), 0.0)
        wide = RadialDensity(dimension, wide.shape, radial.shape * radial.scale / wide.shape)
        return mixture([(0.8, radial), (0.15, wide), (0.05, nominal)])
    found = fit(rng, x @ basis, weights, components)
    fitted: list[tuple[float, Density]] = []
    wide_parts: list[tuple[float, Density]] = []
    for weight, mean, covariance in zip(found.weights, found.means, found.covariances, strict=True):
        fitted.append((weight, _gaussian(basis, mean, _WIDENED * covariance)))
        values, vectors = np.linalg.eigh(covariance)
        wide_parts.append((weight, _gaussian(basis, mean, (vectors * np.maximum(values, 1.0)) @ vectors.T)))
    return mixture(
        [
            (_FITTED_SHARE, mixture(fitted)),
            (_WIDE_SHARE, mixture(wide_parts)),
            (_RADIAL_SHARE, radial),
            (_NOMINAL_SHARE, nominal),
        ]
    )


def _gaussian(basis: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> SubspaceGaussian:
    return SubspaceGaussian(basis, mean, np.linalg.cholesky(covariance))


def _radial(x: np.ndarray, weights: np.ndarray) -> RadialDensity:
    """Radial law with the mean and variance of the squared radii of weighted points."""
    squares = np.sum(x**2, axis=1)
    mean = float(np.sum(weights * squares))
    variance = max(float(np.sum(weights * (squares - mean) ** 2)), 1e-3 * mean**2)
    return RadialDensity(x.shape[1], mean**2 / variance, variance / mean)
