"""Status of a campaign."""

import pytest
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing

from rpojax.campaign.status import status
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.outcomes.outcome_kinds import Outcome


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory, mission: ScenarioFile) -> Campaign:
    """Five runs in three blocks, the first finished."""
    campaign = empty_campaign(tmp_path_factory.mktemp("begun") / "runs", mission, 7, 5, 10, 2)
    campaign.write_block(0, synthetic_block(0), synthetic_timing())
    return campaign


def test_status_sums_the_manifests(begun: Campaign) -> None:
    found = status(begun.directory)
    assert found["blocks"] == {"total": 3, "done": 1, "missing": 2}
    outcomes = {**dict.fromkeys(map(str, Outcome), 0), "completed": 1, "keep_out": 1}
    assert found["runs"] == {
        "requested": 5,
        "completed": 1,
        "failed": 1,
        "not_judged": 0,
        "missing": 3,
        "outcomes": outcomes,
    }
    assert found["reasons"] == {"entered the keep-out sphere": 1}
    assert found["report"] is None
