"""Analyses of one servicer alone refuse a team with one line."""

import pytest
from scenario_error_assertions import assert_one_line

import rpojax
from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader


def test_linear_covariance_refuses_a_team() -> None:
    with pytest.raises(ScenarioError) as caught:
        rpojax.linear_covariance(scenario_loader.load("cooperative_far"))
    assert_one_line(caught.value, "servicers", "linear covariance")


def test_derivatives_refuse_a_team() -> None:
    with pytest.raises(ScenarioError) as caught:
        rpojax.gradient(scenario_loader.load("cooperative_far"), ["servicer.mass_kg"])
    assert_one_line(caught.value, "servicers", "derivatives")
