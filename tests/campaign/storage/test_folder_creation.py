"""Creation of campaign folders by one process or by several at once."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing

from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.storage import atomic_files, folder_creation
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.campaign.storage.provenance import new_configuration
from rpojax.errors import OutputError, ResultError
from rpojax.scenario.schema import ScenarioFile


def configuration(mission: ScenarioFile, seed: int = 7) -> CampaignConfiguration:
    return new_configuration(mission, CampaignOptions(5, seed, block_size=2, histories=Retention("none")))


def test_first_process_creates_the_folder_and_others_with_the_same_configuration_join(
    mission: ScenarioFile, tmp_path: Path
) -> None:
    out = tmp_path / "runs"
    folder_creation.join_folder(out, configuration(mission))
    before = (out / "campaign.json").read_bytes()
    folder_creation.join_folder(out, configuration(mission))
    assert (out / "campaign.json").read_bytes() == before
    with pytest.raises(ResultError, match="found seed 7, expected 8 to share the folder"):
        folder_creation.join_folder(out, configuration(mission, seed=8))
    with pytest.raises(OutputError, match="force=True"):
        folder_creation.create_folder(out, configuration(mission), force=False)
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


def test_folder_created_meanwhile_by_another_process_is_joined(
    mission: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "runs"
    folder_creation.join_folder(out, configuration(mission))
    # The folder appears between the check and the rename.
    monkeypatch.setattr(os.path, "lexists", lambda path: Path(path) != out and Path(path).exists())
    monkeypatch.setattr(folder_creation, "_takes_place", lambda made, place, force: False)
    folder_creation.join_folder(out, configuration(mission))
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


def test_partial_folder_of_a_killed_process_is_removed(mission: ScenarioFile, tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    left = tmp_path / f".runs.{atomic_files.machine_id()}-{process.pid}-0.partial"
    left.mkdir()
    (left / "scenario.toml").touch()
    folder_creation.create_folder(tmp_path / "runs", configuration(mission), force=False)
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


def test_existing_folder_is_not_changed_without_force(empty: Campaign, mission: ScenarioFile) -> None:
    before = (empty.directory / "campaign.json").read_bytes()
    with pytest.raises(OutputError, match="force=True"):
        empty_campaign(empty.directory, mission, 8, 1, 0, 1)
    assert (empty.directory / "campaign.json").read_bytes() == before


def test_force_replaces_a_campaign_and_its_report(empty: Campaign, mission: ScenarioFile) -> None:
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    (empty.directory / "report.html").write_text("old")
    new = empty_campaign(empty.directory, mission, 8, 1, 0, 1, force=True)
    assert sorted(path.name for path in new.directory.iterdir()) == ["campaign.json", "scenario.toml"]
    assert new.info["seed"] == 8


@pytest.mark.parametrize("text", [None, '{"name": "of another tool"}'])
def test_force_removes_only_campaigns(mission: ScenarioFile, tmp_path: Path, text: str | None) -> None:
    folder = tmp_path / "precious"
    folder.mkdir()
    (folder / "thesis.tex").write_text("years of work")
    if text is not None:
        (folder / "campaign.json").write_text(text)
    with pytest.raises(OutputError, match="no campaign"):
        empty_campaign(folder, mission, 8, 1, 0, 1, force=True)
    assert (folder / "thesis.tex").read_text() == "years of work"


def test_folder_that_cannot_be_made_is_an_output_error(mission: ScenarioFile, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="expected a folder to write to"):
        empty_campaign(tmp_path / ("x" * 300), mission, 8, 1, 0, 1)
