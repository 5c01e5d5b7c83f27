"""Manifests are checked, and their times and attempts counted."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing
from hypothesis import given
from hypothesis import strategies as st
from spoilt_campaign_files import JSON, read_all, read_with

from rpojax.campaign.status import status
from rpojax.campaign.storage import block_manifests
from rpojax.campaign.storage.block_manifests import Manifest
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError
from rpojax.scenario.schema import ScenarioFile

ENTRY = Manifest("0f", 0, 2, 1, 1, {"x": 1}, {"metrics": "0" * 64}, 100.0, 10.0, 3.0, 1, "a cpu", {"jax": "1"})


RUNS, BLOCK = 60, 2


@given(key=st.sampled_from(sorted(Manifest.__dataclass_fields__)), value=JSON)
def test_any_entry_is_read_or_refused_in_one_line(begun: Campaign, key: str, value: Any) -> None:
    read_with(begun, "manifest/000000.json", key, value)


def test_manifest_of_another_block_is_refused(begun: Campaign, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(begun.directory, tmp_path / "copy"))
    shutil.copy(copy / "manifest" / "000000.json", copy / "manifest" / "000001.json")
    with pytest.raises(ResultError, match=r"000001\.json: found first 0, count 2, expected first 2, count 2"):
        read_all(copy)


@pytest.mark.parametrize("name", ["999999.json", "../000001.json", "1.json", "000001.json.partial", "00000x.json"])
def test_other_file_names_are_ignored(begun: Campaign, tmp_path: Path, name: str) -> None:
    copy = Path(shutil.copytree(begun.directory, tmp_path / "copy"))
    (copy / "manifest" / name).write_text("{}")
    assert Campaign(copy).missing_blocks() == [1, 2]


def test_run_time_is_the_union_of_the_blocks_times() -> None:
    at_once = [ENTRY, replace(ENTRY, wall_s=12.0)]
    later = [replace(ENTRY, began_s=200.0, compile_s=5.0)]
    timing = block_manifests.timing([*later, *at_once], duration_s=60.0)
    assert timing == {"compile_s": 5.0, "run_s": 22.0, "run_seconds_per_s": 6 * 60.0 / 22.0, "devices": 2}
    in_sequence = [ENTRY, replace(ENTRY, began_s=110.0)]
    assert block_manifests.timing(in_sequence, 60.0)["devices"] == 1
    assert block_manifests.timing([], 60.0) == {}


def test_attempts_are_counted_until_the_block_is_finished(mission: ScenarioFile, tmp_path: Path) -> None:
    campaign = empty_campaign(tmp_path / "runs", mission, 7, 5, 10, 2)
    for _ in range(2):
        block_manifests.record_attempt(campaign.directory, 1)
    assert block_manifests.attempts_at_unfinished_blocks(campaign.directory, 3) == {1: 2}
    assert status(campaign.directory)["begun"] == [{"block": 1, "attempts": 2}]
    campaign.write_block(1, synthetic_block(1), synthetic_timing())
    assert campaign.manifests[1].attempts == 2
    assert block_manifests.attempts_at_unfinished_blocks(campaign.directory, 3) == {}


def test_manifest_of_another_campaign_is_refused(mission: ScenarioFile, tmp_path: Path) -> None:
    one = empty_campaign(tmp_path / "one", mission, 7, RUNS, 0, BLOCK)
    other = empty_campaign(tmp_path / "other", mission, 7, RUNS, 0, BLOCK)
    one.write_block(0, synthetic_block(0), synthetic_timing())
    (other.directory / "manifest").mkdir()
    shutil.copy(one.directory / "manifest" / "000000.json", other.directory / "manifest")
    with pytest.raises(ResultError, match=r"seal of another campaign\.json"):
        _ = other.manifests


@pytest.mark.parametrize("text", ["", "[]", '{"first": 0}'])
def test_incomplete_manifest_is_refused(empty: Campaign, text: str) -> None:
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    (empty.directory / "manifest" / "000000.json").write_text(text)
    with pytest.raises(ResultError, match="runs the block again"):
        _ = Campaign(empty.directory).completed
