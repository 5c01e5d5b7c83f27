"""Rerun of one run of a campaign."""

from pathlib import Path

import pytest
from empty_campaign_folders import empty_campaign

from rpojax.campaign import rerun
from rpojax.errors import OutputError
from rpojax.scenario.schema import ScenarioFile


def test_rerun_into_the_campaigns_own_folder_is_refused(mission: ScenarioFile, tmp_path: Path) -> None:
    campaign = empty_campaign(tmp_path / "runs", mission, 7, 5, 0, 2)
    for place in (tmp_path / "runs", tmp_path):
        with pytest.raises(OutputError, match="where the campaign itself is"):
            rerun.rerun(campaign, 0, place, force=True)
    assert (tmp_path / "runs" / "campaign.json").is_file()
