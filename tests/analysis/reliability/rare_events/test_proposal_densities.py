"""Densities from which importance sampling draws are normalised and are those of their points."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from rpojax.analysis.reliability.rare_events import proposal_fit
from rpojax.analysis.reliability.rare_events.proposal_densities import (
    Density,
    RadialDensity,
    SubspaceGaussian,
    log_nominal,
    mixture,
)
from rpojax.analysis.reliability.rare_events.proposal_fit import WeightedFailures

BASIS = np.linalg.qr(np.random.default_rng(1).standard_normal((5, 2)))[0]
FACTOR = np.array([[0.6, 0.0], [0.3, 1.2]])
GAUSSIAN = SubspaceGaussian(BASIS, np.array([1.5, -0.5]), FACTOR)
RADIAL = RadialDensity(5, 4.0, 2.0)


def test_a_gaussian_in_a_subspace_is_that_of_scipy() -> None:
    across = np.eye(5) - BASIS @ BASIS.T
    covariance = BASIS @ FACTOR @ FACTOR.T @ BASIS.T + across
    x = np.random.default_rng(2).standard_normal((20, 5))
    expected = multivariate_normal(BASIS @ GAUSSIAN.mean, covariance).logpdf(x)
    np.testing.assert_allclose(GAUSSIAN.log_density(x), expected, rtol=1e-10)


@pytest.mark.parametrize("density", [GAUSSIAN, RADIAL, mixture([(0.3, GAUSSIAN), (0.7, RADIAL)])])
def test_weights_of_the_nominal_density_have_mean_one(density: Density) -> None:
    """Within five standard errors of their own sample."""
    wide = mixture([(0.5, density), (0.5, SubspaceGaussian(np.eye(5), np.zeros(5), np.eye(5)))])
    x = wide.sample(np.random.default_rng(3), 40_000)
    weights = np.exp(log_nominal(x) - wide.log_density(x))
    assert weights.mean() == pytest.approx(1.0, abs=5.0 * weights.std() / np.sqrt(len(weights)))
    own = np.exp(density.log_density(x) - wide.log_density(x))
    assert own.mean() == pytest.approx(1.0, abs=5.0 * own.std() / np.sqrt(len(own)))


def test_a_fit_finds_two_clusters() -> None:
    rng = np.random.default_rng(4)
    y = np.concatenate([rng.normal(3.0, 0.3, (300, 2)), rng.normal(-3.0, 0.3, (100, 2))])
    found = proposal_fit.fit(rng, y, np.full(400, 1 / 400), 2)
    order = np.argsort(found.means[:, 0])
    np.testing.assert_allclose(found.means[order], [[-3.0, -3.0], [3.0, 3.0]], atol=0.15)
    np.testing.assert_allclose(found.weights[order], [0.25, 0.75], atol=0.02)


def test_a_proposal_bounds_its_weights_by_its_nominal_part() -> None:
    rng = np.random.default_rng(5)
    x = rng.standard_normal((200, 3)) * 0.2 + np.array([4.0, 0.0, 0.0])
    proposal = proposal_fit.fit_proposal(rng, WeightedFailures(x, np.ones(200), np.arange(200)))
    anywhere = 3.0 * rng.standard_normal((1000, 3))
    assert np.exp(log_nominal(anywhere) - proposal.log_density(anywhere)).max() <= 1.0 / 0.05 + 1e-9
