"""Linear covariance of a short run against sampled runs, and scenarios that are refused."""

import numpy as np
import pytest

from rpojax.analysis.linear_covariance import covariance_propagation, monte_carlo_agreement
from rpojax.analysis.linear_covariance.analysis_setup import AnalysisSetup
from rpojax.errors import RpojaxError, ScenarioError
from rpojax.flight.stages import Stages
from rpojax.scenario.loading import scenario_loader

OVERRIDES = ("camera.outlier_probability=0.0", "duration_s=400.0")


@pytest.mark.slow
def test_the_covariance_of_a_short_run_is_that_of_sampled_runs() -> None:
    file = scenario_loader.load("inspection", OVERRIDES)
    linear = covariance_propagation.propagate_covariance(file, members=64)
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


@pytest.mark.parametrize(
    ("overrides", "named"),
    [
        (["camera.model='statistical'"], "camera.model"),
        (["effects.faults=true"], "effects.faults"),
        (["chamber_pressure.enabled=true"], "chamber_pressure.enabled"),
        (["camera.edge_noise_px=0.0"], "camera.edge_noise_px"),
        (["camera.distortion=[-0.1, 0.0, 0.0, 0.0, 0.0]"], "camera.distortion"),
        (["dispersions=[{key='gps.noise_m', kind='choice', values=[1.0, 2.0]}]"], "gps.noise_m"),
        (["dispersions=[]", "design={kind='grid', values={'servicer.mass_kg'=[29, 31]}}"], "design.kind"),
    ],
)
def test_effects_without_a_derivative_are_refused(overrides: list[str], named: str) -> None:
    with pytest.raises(RpojaxError, match=named):
        covariance_propagation.check_scenario(scenario_loader.load("inspection", overrides))


def test_missions_with_phases_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"^phases: found 1, expected a scenario without phases"):
        AnalysisSetup(scenario_loader.load("safety_ellipse"), 1, Stages())
