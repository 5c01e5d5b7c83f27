"""A live run knows one servicer alone."""

import pytest
from scenario_error_assertions import assert_one_line

from rpojax.errors import ScenarioError
from rpojax.interop.cosimulation.live_run import simulate_live
from rpojax.interop.cosimulation.live_settings import LiveSettings
from rpojax.scenario.loading import scenario_loader


def test_a_live_run_refuses_a_team_before_it_joins_the_network() -> None:
    lines: list[str] = []
    with pytest.raises(ScenarioError) as caught:
        simulate_live(scenario_loader.load("cooperative_far"), 0, 0, LiveSettings(), lines.append)
    assert_one_line(caught.value, "servicers", "a live run")
    assert lines == []
