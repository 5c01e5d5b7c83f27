"""Linear covariance of a short run against sampled runs, and what is made of the two."""

import numpy as np
import pytest
from synthetic_linear_covariance import synthetic_linear_covariance

from rpojax.analysis.linear_covariance import error_budget, linear_covariance, monte_carlo_agreement
from rpojax.scenario import scenario_file

OVERRIDES = ("camera.outlier_probability=0.0", "duration_s=400.0")


def test_samples_of_the_same_law_agree_and_wider_ones_do_not() -> None:
    for row in monte_carlo_agreement.compare_with_sample(*synthetic_linear_covariance()):
        assert row.median == pytest.approx(1.0, abs=0.03)
        assert row.disagrees == 0.0
        assert row.within == 1.0
    for row in monte_carlo_agreement.compare_with_sample(*synthetic_linear_covariance(scale=1.5)):
        assert row.median == pytest.approx(1.0 / 1.5, abs=0.03)
        assert row.disagrees == 1.0
        assert row.largest < 0.85


def test_the_interval_of_a_sampled_sigma_holds_the_true_one_about_as_often_as_it_says() -> None:
    linear, sampled = synthetic_linear_covariance()
    low, high = sampled.sigma_interval("rho_H")
    inside = (low < linear.sigma("rho_H")) & (linear.sigma("rho_H") < high)
    assert 0.88 < inside.mean() < 1.0


def test_the_budget_adds_up_in_squares() -> None:
    linear, _ = synthetic_linear_covariance()
    found = error_budget.error_budget(linear)
    for title, output in error_budget.ERRORS.items():
        total = np.sqrt(np.sum(linear.sigma(output)[-1] ** 2))
        assert found.total_at_end[title] == pytest.approx(total)
        assert found.at_end[title]["one"] == pytest.approx(0.6 * total)
        assert found.at_worst[title]["other"] == pytest.approx(0.8 * total)


@pytest.mark.slow
def test_a_short_run_spreads_as_sampled_runs_do() -> None:
    file = scenario_file.load("inspection", OVERRIDES)
    linear = linear_covariance.analyse_scenario(file, members=64)
    sampled = monte_carlo_agreement.simulate_sample(file, 200, 0)
    assert sampled.failed == 0
    by_sigma = {(row.channel, row.component): row for row in monte_carlo_agreement.compare_with_sample(linear, sampled)}
    for component in "xyz":
        row = by_sigma["rho_H", component]
        assert row.disagrees == 0.0
        assert row.median == pytest.approx(1.0, abs=0.1)
    # 200 runs leave 10 % open at 95 %.
    assert by_sigma["relative_error_H", "y"].median == pytest.approx(1.0, abs=0.15)
    total = np.sqrt(linear.shares[-1].sum(axis=0))
    rows = np.searchsorted(linear.time_s, linear.share_time_s[-1])
    expected = np.sqrt(np.diag(linear.covariance[rows]))
    np.testing.assert_allclose(total, expected, rtol=1e-6, atol=1e-12)
