"""Manifests and `campaign.json` are data of strangers: one kind of error, and nothing outside of the folder."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing
from hypothesis import given
from hypothesis import strategies as st

from rpojax.campaign.status import status
from rpojax.campaign.storage import block_manifests, campaign_json
from rpojax.campaign.storage.block_manifests import Manifest
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError, RpojaxError
from rpojax.scenario.schema import ScenarioFile

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)
ENTRY = Manifest("0f", 0, 2, 1, 1, {"x": 1}, {"metrics": "0" * 64}, 100.0, 10.0, 3.0, 1, "a cpu", {"jax": "1"})


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory, mission: ScenarioFile) -> Campaign:
    """Five runs in three blocks, the first done; tests put back what they change."""
    made = empty_campaign(tmp_path_factory.mktemp("begun") / "runs", mission, 7, 5, 10, 2)
    made.write_block(0, synthetic_block(0), synthetic_timing())
    return made


def read_all(directory: Path) -> None:
    """Everything that a reader may look at."""
    found = Campaign(directory)
    for name in ("info", "metrics", "drawn", "traces", "completed", "failed_at_s", "run_ids", "history_ids"):
        getattr(found, name)
    status(directory)


def read_with(begun: Campaign, name: str, key: str, value: Any) -> None:
    """Reads everything with another entry in a file; what is refused is so in one line."""
    path = begun.directory / name
    before = path.read_bytes()
    try:
        path.write_text(json.dumps(json.loads(before) | {key: value}))
        read_all(begun.directory)
    except RpojaxError as error:
        assert "\n" not in str(error)
    finally:
        path.write_bytes(before)


@given(key=st.sampled_from(sorted({*campaign_json._REQUIRED_ENTRIES, "format"})), value=JSON)
def test_whatever_campaign_json_holds_is_read_or_refused_in_one_line(begun: Campaign, key: str, value: Any) -> None:
    read_with(begun, "campaign.json", key, value)


@given(key=st.sampled_from(sorted(Manifest.__dataclass_fields__)), value=JSON)
def test_whatever_a_manifest_holds_is_read_or_refused_in_one_line(begun: Campaign, key: str, value: Any) -> None:
    read_with(begun, "manifest/000000.json", key, value)


def contents(path: Path) -> dict[str, bytes]:
    """Every file below a path, or the file itself."""
    return {str(file): file.read_bytes() for file in [path, *path.rglob("*")] if file.is_file()}


def test_the_manifest_of_another_block_is_refused(begun: Campaign, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(begun.directory, tmp_path / "copy"))
    shutil.copy(copy / "manifest" / "000000.json", copy / "manifest" / "000001.json")
    with pytest.raises(ResultError, match=r"000001\.json: found first 0, count 2, expected first 2, count 2"):
        read_all(copy)


@pytest.mark.parametrize("name", ["999999.json", "../000001.json", "1.json", "000001.json.partial", "00000x.json"])
def test_names_that_are_no_blocks_of_the_campaign_count_for_nothing(begun: Campaign, tmp_path: Path, name: str) -> None:
    copy = Path(shutil.copytree(begun.directory, tmp_path / "copy"))
    (copy / "manifest" / name).write_text("{}")
    assert Campaign(copy).missing_blocks() == [1, 2]


@pytest.mark.parametrize("part", ["campaign.json", "manifest", "results.zarr", "results.zarr/metrics"])
def test_parts_that_are_links_are_neither_read_nor_written(begun: Campaign, tmp_path: Path, part: str) -> None:
    copy = Path(shutil.copytree(begun.directory, tmp_path / "copy"))
    outside = tmp_path / "outside"
    shutil.move(copy / part, outside)
    (copy / part).symlink_to(outside)
    before = contents(outside)
    with pytest.raises(ResultError, match="found a link that leads elsewhere"):
        read_all(copy)
    with pytest.raises(ResultError, match="found a link that leads elsewhere"):
        Campaign(copy).write_block(1, synthetic_block(1), synthetic_timing())
    assert contents(outside) == before


def test_time_counts_once_where_blocks_are_done_at_once_and_not_in_between() -> None:
    at_once = [ENTRY, replace(ENTRY, wall_s=12.0)]
    later = [replace(ENTRY, began_s=200.0, compile_s=5.0)]
    timing = block_manifests.timing([*later, *at_once], duration_s=60.0)
    assert timing == {"compile_s": 5.0, "run_s": 22.0, "run_seconds_per_s": 6 * 60.0 / 22.0, "devices": 2}
    one_after_the_other = [ENTRY, replace(ENTRY, began_s=110.0)]
    assert block_manifests.timing(one_after_the_other, 60.0)["devices"] == 1
    assert block_manifests.timing([], 60.0) == {}


def test_attempts_are_counted_until_the_block_is_done(mission: ScenarioFile, tmp_path: Path) -> None:
    made = empty_campaign(tmp_path / "runs", mission, 7, 5, 10, 2)
    for _ in range(2):
        block_manifests.record_attempt(made.directory, 1)
    assert block_manifests.attempts_at_unfinished_blocks(made.directory, 3) == {1: 2}
    assert status(made.directory)["begun"] == [{"block": 1, "attempts": 2}]
    made.write_block(1, synthetic_block(1), synthetic_timing())
    assert made.manifests[1].attempts == 2
    assert block_manifests.attempts_at_unfinished_blocks(made.directory, 3) == {}


def test_the_status_counts_what_manifests_say(begun: Campaign) -> None:
    found = status(begun.directory)
    assert found["blocks"] == {"total": 3, "done": 1, "missing": 2}
    assert found["runs"] == {"requested": 5, "completed": 1, "failed": 1, "missing": 3}
    assert found["reasons"] == {"entered the keep-out sphere": 1}
    assert found["report"] is None
