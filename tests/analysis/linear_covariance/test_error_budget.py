"""The error budget of a synthetic linear covariance."""

import numpy as np
import pytest
from synthetic_linear_covariance import synthetic_linear_covariance

from rpojax.analysis.linear_covariance import covariance_propagation


def test_the_squares_of_the_budget_add_up() -> None:
    linear, _ = synthetic_linear_covariance()
    found = covariance_propagation.error_budget(linear)
    for title, output in covariance_propagation.ERRORS.items():
        total = np.sqrt(np.sum(linear.sigma(output)[-1] ** 2))
        assert found.total_at_end[title] == pytest.approx(total)
        assert found.at_end[title]["one"] == pytest.approx(0.6 * total)
        assert found.at_worst[title]["other"] == pytest.approx(0.8 * total)
