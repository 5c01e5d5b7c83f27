"""Analyses of one servicer alone refuse a team with one line."""

from pathlib import Path

import pytest
from scenario_error_assertions import assert_one_line

import rpojax
from rpojax.cli import main
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


def test_searches_with_derivatives_refuse_a_team_before_they_simulate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    search = ["--limit", "1", "--out", str(tmp_path / "search")]
    for command, options in (("sensitivity", []), ("worst-case", search)):
        assert main.main([command, "cooperative_far", "--metric", "min_range_m", *options]) == 2
        error = capsys.readouterr().err
        assert "servicers: found 2, expected a scenario without [[servicers]] for derivatives of runs" in error
        assert "simulating" not in error
        assert "searching" not in error
