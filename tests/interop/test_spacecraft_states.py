"""States of every spacecraft of a scenario: names, and the start of a team against that of each servicer alone."""

from pathlib import Path

import numpy as np
import pytest
from empty_campaign_folders import empty_campaign

from rpojax.campaign import single_run
from rpojax.errors import ScenarioError
from rpojax.interop import spacecraft_states
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

SEED, RUN = 5, 3


def test_spacecraft_are_the_servicers_and_the_target(inspection_file: ScenarioFile) -> None:
    team = scenario_loader.load("cooperative_inspection")
    assert spacecraft_states.spacecraft_names(inspection_file) == ("servicer", "target")
    assert spacecraft_states.spacecraft_names(team) == ("first", "second", "third", "target")


def test_a_servicer_with_the_name_of_the_target_is_refused() -> None:
    team = scenario_loader.load("cooperative_inspection")
    first = team.servicers[0].model_copy(update={"name": "target"})
    with pytest.raises(ScenarioError, match=r"servicers.name: found 'target', expected another name"):
        spacecraft_states.spacecraft_names(team.model_copy(update={"servicers": [first, *team.servicers[1:]]}))


@pytest.mark.slow
def test_each_servicer_of_a_team_starts_as_alone(tmp_path: Path) -> None:
    file = scenario_loader.load("cooperative_inspection")
    *servicers, target = spacecraft_states.initial_states(empty_campaign(tmp_path / "runs", file, SEED, 4, 0, 1), RUN)
    assert [each.spacecraft for each in servicers] == ["first", "second", "third"]
    for number, found in enumerate(servicers):
        truth = single_run.initialise_run(file, SEED, RUN, servicer=number)[2].truth
        np.testing.assert_allclose(target.position_m[0], truth.r_TN_N, rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(found.position_m[0], truth.r_TN_N + truth.r_ST_N, rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(found.velocity_m_s[0], truth.v_TN_N + truth.v_ST_N, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(found.q[0], truth.q_BN, rtol=0.0, atol=1e-12)
