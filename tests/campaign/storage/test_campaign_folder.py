"""The folder: whole or absent, manifest last, undefined numbers, refusals."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zarr
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing

from rpojax.campaign.storage import atomic_files
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import OutputError, ResultError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.failure import FAILURE_REASONS

RUNS, BLOCK = 5, 2


@pytest.fixture
def empty(mission: ScenarioFile, tmp_path: Path) -> Campaign:
    """A campaign of five runs in three blocks, none of them done."""
    return empty_campaign(tmp_path / "runs", mission, 7, RUNS, 10, BLOCK, [10])


def test_a_new_folder_says_what_is_to_be_run_before_anything_is(empty: Campaign, mission: ScenarioFile) -> None:
    info = json.loads((empty.directory / "campaign.json").read_text())
    assert (info["seed"], info["runs"], info["first_run"], info["block_size"]) == (7, RUNS, 10, BLOCK)
    assert {"rpojax", "jax", "numpy", "python"} <= set(info["versions"])
    assert empty.file == mission
    assert empty.missing_blocks() == [0, 1, 2]
    assert empty.run_ids.tolist() == []
    assert empty.metrics == {}
    assert empty.history_ids == []


def test_blocks_hold_consecutive_runs_and_the_last_is_padded_to_full_size(empty: Campaign) -> None:
    assert [empty.block_run_ids(block).tolist() for block in range(empty.block_count)] == [[10, 11], [12, 13], [14, 15]]


def test_rows_of_finished_blocks_are_read_back_whatever_order_they_came_in(empty: Campaign) -> None:
    empty.write_block(2, synthetic_block(2), synthetic_timing())
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    read = Campaign(empty.directory)
    assert read.missing_blocks() == [1]
    assert read.run_ids.tolist() == [10, 11, 14]
    np.testing.assert_array_equal(read.metrics["min_range_m"], [0.0, np.nan, 4.0])
    np.testing.assert_array_equal(read.drawn["target.tumble_axis"][:, 1], [0.0, -1.0, -4.0])
    np.testing.assert_array_equal(read.failed_at_s, [np.nan, 12.0, np.nan])
    assert read.failure_reason.tolist() == ["", FAILURE_REASONS[2], ""]
    assert read.completed.tolist() == [True, False, True]
    assert read.traces["range_m"].dtype == np.float32


def test_padding_is_not_stored(empty: Campaign, arrays: Callable[[Path], dict[str, np.ndarray]]) -> None:
    for block in range(3):
        empty.write_block(block, synthetic_block(block), synthetic_timing())
    assert all(len(values) == RUNS for values in arrays(empty.directory).values())
    manifest = json.loads((empty.directory / "manifest" / "000002.json").read_text())
    assert manifest.items() >= {"first": 4, "count": 1, "completed": 1, "failed": 0, "reasons": {}}.items()
    assert manifest["attempts"] == 1
    assert set(manifest["sha256"]) == {"metrics", "drawn", "traces", "status"}
    assert {"rpojax", "jax", "numpy", "zarr", "python"} == set(manifest["versions"])


def test_a_block_counts_only_once_its_manifest_is_there(empty: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    def die(path: Path, content: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(atomic_files, "write_json", die)
        with pytest.raises(KeyboardInterrupt):
            empty.write_block(0, synthetic_block(0), synthetic_timing())
    read = Campaign(empty.directory)
    assert read.missing_blocks() == [0, 1, 2]
    assert read.metrics == {}
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    assert read.metrics["min_range_m"][0] == 0.0


def test_the_scenario_lies_beside_the_results_as_a_file_that_loads_to_the_same(
    empty: Campaign, mission: ScenarioFile
) -> None:
    assert scenario_loader.load(empty.directory / "scenario.toml") == mission


def lost(path: Path) -> str:
    path.unlink()
    return "found nothing"


def garbled(path: Path) -> str:
    path.write_bytes(b"garbage")
    return "readable arrays"


@pytest.mark.parametrize("group", ["metrics", "traces", "drawn", "status"])
@pytest.mark.parametrize("spoil", [lost, garbled])
def test_chunks_that_are_lost_or_garbled_are_never_read_as_results(
    empty: Campaign, group: str, spoil: Callable[[Path], str]
) -> None:
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    chunk = next(path for path in (empty.directory / "results.zarr" / group).rglob("c/**/0") if path.is_file())
    words = spoil(chunk)
    read = Campaign(empty.directory)
    with pytest.raises(ResultError, match=words) as caught:
        _ = read.completed if group == "status" else getattr(read, group)
    assert "\n" not in str(caught.value)


def test_a_chunk_of_fill_values_alone_is_there_too(empty: Campaign) -> None:
    empty.write_block(0, {**synthetic_block(0), "metrics/time_to_acquire_s": np.full(2, np.nan)}, synthetic_timing())
    assert np.isnan(Campaign(empty.directory).metrics["time_to_acquire_s"]).all()
    empty.write_history(10, {"delta_v_m_s": np.zeros(3), "box_present": np.zeros(3, bool)})
    assert empty.history(10)["delta_v_m_s"].tolist() == [0.0, 0.0, 0.0]
    lost(empty.directory / "results.zarr" / "histories" / "10" / "delta_v_m_s" / "c" / "0")
    with pytest.raises(ResultError, match="found nothing"):
        empty.history(10)


def test_a_status_that_was_never_written_is_unknown_and_no_success(empty: Campaign) -> None:
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    status = zarr.open_group(str(empty.directory / "results.zarr"), mode="r+")["status/failure"]
    assert isinstance(status, zarr.Array)
    assert status.fill_value == -1
    status[:2] = np.array([0, 0], np.int8)
    with pytest.raises(ResultError, match="status: found other values in block 0, expected"):
        _ = Campaign(empty.directory).completed


def test_results_that_are_gone_are_missed_once_a_block_is_done(empty: Campaign) -> None:
    assert empty.metrics == {}
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    shutil.rmtree(empty.directory / "results.zarr")
    for group in ("metrics", "drawn", "traces", "completed"):
        with pytest.raises(ResultError, match=r"results\.zarr"):
            getattr(Campaign(empty.directory), group)


@pytest.mark.parametrize("text", ["", "[]", '{"first": 0}'])
def test_a_manifest_that_counts_nothing_is_refused(empty: Campaign, text: str) -> None:
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    (empty.directory / "manifest" / "000000.json").write_text(text)
    with pytest.raises(ResultError, match="runs the block again"):
        _ = Campaign(empty.directory).completed


@pytest.mark.parametrize(
    ("key", "value"), [("runs", None), ("runs", 0), ("block_size", 0), ("seed", "1"), ("scenario", []), ("stages", 3)]
)
def test_a_campaign_without_one_of_its_entries_is_refused_by_its_name(
    empty: Campaign, edit_info: Callable[..., None], key: str, value: object
) -> None:
    edit_info(empty.directory, **{key: value})
    with pytest.raises(ResultError, match=f"{key!r}, expected the"):
        Campaign(empty.directory)


def test_json_is_replaced_as_a_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "some.json"
    atomic_files.write_json(path, {"a": 1})
    with pytest.raises(ValueError, match="not JSON compliant"):
        atomic_files.write_json(path, {"a": 2, "b": float("nan")})
    assert json.loads(path.read_text()) == {"a": 1}


def test_a_history_is_read_back_and_can_be_written_again(empty: Campaign) -> None:
    channels = {"time_s": np.arange(4.0), "mode": np.arange(4, dtype=np.int8), "rho_H": np.full((4, 3), np.nan)}
    for _ in range(2):
        empty.write_history(10, channels)
    assert empty.history_ids == [10]
    read = empty.history(10)
    assert read.keys() == channels.keys()
    for name, values in channels.items():
        np.testing.assert_array_equal(read[name], values)
        assert read[name].dtype == values.dtype
    with pytest.raises(ResultError, match=r"run 11: found no history, expected one of \[10\]"):
        empty.history(11)


@pytest.mark.parametrize("text", [None, "not json", "[]", "{}", '{"format": 99}'])
def test_a_folder_that_is_no_campaign_is_refused(tmp_path: Path, text: str | None) -> None:
    if text is not None:
        (tmp_path / "campaign.json").write_text(text)
    with pytest.raises(ResultError):
        Campaign(tmp_path)


def test_an_existing_folder_is_left_alone_without_force(empty: Campaign, mission: ScenarioFile) -> None:
    before = (empty.directory / "campaign.json").read_bytes()
    with pytest.raises(OutputError, match="--force"):
        empty_campaign(empty.directory, mission, 8, 1, 0, 1)
    assert (empty.directory / "campaign.json").read_bytes() == before


def test_force_replaces_a_campaign_with_all_it_held(empty: Campaign, mission: ScenarioFile) -> None:
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    (empty.directory / "report.html").write_text("old")
    new = empty_campaign(empty.directory, mission, 8, 1, 0, 1, force=True)
    assert sorted(path.name for path in new.directory.iterdir()) == ["campaign.json", "scenario.toml"]
    assert new.info["seed"] == 8


@pytest.mark.parametrize("text", [None, '{"name": "of another tool"}'])
def test_force_removes_nothing_but_campaigns(mission: ScenarioFile, tmp_path: Path, text: str | None) -> None:
    folder = tmp_path / "precious"
    folder.mkdir()
    (folder / "thesis.tex").write_text("years of work")
    if text is not None:
        (folder / "campaign.json").write_text(text)
    with pytest.raises(OutputError, match="no campaign"):
        empty_campaign(folder, mission, 8, 1, 0, 1, force=True)
    assert (folder / "thesis.tex").read_text() == "years of work"


def test_a_folder_that_cannot_be_made_is_an_error_of_its_own(mission: ScenarioFile, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="expected a folder to write to"):
        empty_campaign(tmp_path / ("x" * 300), mission, 8, 1, 0, 1)
