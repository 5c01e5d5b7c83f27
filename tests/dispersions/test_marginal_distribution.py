"""Distributions of single numbers."""

import numpy as np
import pytest

from rpojax.dispersions.marginal_distribution import discrete_distribution, normal_distributions


def test_a_discrete_distribution_counts_its_values() -> None:
    law = discrete_distribution(np.array([5.0, 0.0, 5.0, 5.0]))
    np.testing.assert_allclose(law.cdf(np.array([-1.0, 0.0, 4.9, 5.0])), [0.0, 0.25, 0.25, 1.0])
    np.testing.assert_array_equal(law.ppf(np.array([1e-9, 0.25, 0.26, 1.0 - 1e-16])), [0.0, 0.0, 5.0, 5.0])
    assert (law.mean(), law.std()) == (3.75, pytest.approx(5.0 * np.sqrt(0.25 * 0.75)))


def test_constants_and_numbers_with_unknown_mean_have_no_normal_distribution() -> None:
    first, constant, unknown = normal_distributions(np.array([1.0, 2.0, np.nan]), [0.5, 0.0, 0.5])
    assert first is not None
    assert (first.mean(), first.std()) == (1.0, 0.5)
    assert constant is None
    assert unknown is None
