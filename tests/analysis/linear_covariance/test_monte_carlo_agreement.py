"""Agreement of a synthetic linear covariance with samples of known standard deviation."""

import pytest
from synthetic_linear_covariance import synthetic_linear_covariance

from rpojax.analysis.linear_covariance import monte_carlo_agreement


def test_samples_of_the_same_distribution_agree_and_wider_ones_do_not() -> None:
    for row in monte_carlo_agreement.compare_with_sample(*synthetic_linear_covariance()):
        assert row.median == pytest.approx(1.0, abs=0.03)
        assert row.disagrees == 0.0
        assert row.within == 1.0
    for row in monte_carlo_agreement.compare_with_sample(*synthetic_linear_covariance(scale=1.5)):
        assert row.median == pytest.approx(1.0 / 1.5, abs=0.03)
        assert row.disagrees == 1.0
        assert row.largest < 0.85


def test_the_interval_of_a_sampled_sigma_has_about_its_stated_coverage() -> None:
    linear, sampled = synthetic_linear_covariance()
    low, high = sampled.sigma_interval("rho_H")
    inside = (low < linear.sigma("rho_H")) & (linear.sigma("rho_H") < high)
    assert 0.88 < inside.mean() < 1.0
