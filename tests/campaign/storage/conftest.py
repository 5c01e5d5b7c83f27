"""Campaign folders without an engine."""

from pathlib import Path

import pytest
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture
def empty(mission: ScenarioFile, tmp_path: Path) -> Campaign:
    """A campaign of five runs from number 10 in three blocks, none of them finished; one history is to be kept."""
    return empty_campaign(tmp_path / "runs", mission, 7, 5, 10, 2, [10])


@pytest.fixture(scope="session")
def begun(tmp_path_factory: pytest.TempPathFactory, mission: ScenarioFile) -> Campaign:
    """Five runs in three blocks, the first finished; tests restore what they change."""
    campaign = empty_campaign(tmp_path_factory.mktemp("begun") / "runs", mission, 7, 5, 10, 2)
    campaign.write_block(0, synthetic_block(0), synthetic_timing())
    return campaign
