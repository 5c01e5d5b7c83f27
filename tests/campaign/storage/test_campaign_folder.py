"""Campaign folders: blocks are written with their manifest last, and read back."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing

from rpojax.campaign.status import status
from rpojax.campaign.storage import atomic_files
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError, ScenarioError, UnfinishedError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.outcomes.outcome_kinds import REASONS, Outcome


def test_new_folder_holds_the_configuration_and_no_runs(empty: Campaign, mission: ScenarioFile) -> None:
    info = json.loads((empty.directory / "campaign.json").read_text())
    assert (info["seed"], info["runs"], info["first_run"], info["block_size"]) == (7, 5, 10, 2)
    assert {"rpojax", "jax", "numpy", "python"} <= set(info["versions"])
    assert empty.file == mission
    assert empty.missing_blocks() == [0, 1, 2]
    assert empty.run_ids.tolist() == []
    assert empty.metrics == {}
    assert empty.history_ids == []


def test_the_scenario_of_an_older_format_is_read_though_it_may_not_be_simulated_anew(empty: Campaign) -> None:
    tables = empty.configuration.scenario
    navigation = {key: value for key, value in tables["navigation"].items() if key != "confirm_tolerance_deg_s"}
    own_hull = [[2.0 * value for value in point] for point in tables["target"]["hull_m"]]
    older = {
        **tables,
        "format_version": 2,
        "navigation": {**navigation, "confirm_tolerance_px_s": 20.0},
        "target": {**tables["target"], "hull_m": own_hull},
        "camera": {**tables["camera"], "model": "rendered", "width_px": 1000, "field_of_view_deg": 90.0},
        "effects": {**tables["effects"], "faults": True},
        "chamber_pressure": {},
    }
    empty.configuration = dataclasses.replace(empty.configuration, scenario=older)
    found = empty.file
    assert found.target.hull_m == pytest.approx(np.array(own_hull))
    assert found.chamber_pressure.enabled
    # The middle pixel of 1000 on 90 deg is 2 / 1000 wide at a distance of 1.
    assert found.navigation.confirm_tolerance_deg_s == pytest.approx(np.degrees(20.0 * 2.0 / 1000.0))
    assert empty.requirements == found.requirements
    assert empty.configuration.scenario["format_version"] == 2
    with pytest.raises(ScenarioError):
        scenario_loader.validate({**older, "format_version": found.format_version})


def test_last_block_is_padded_to_full_size(empty: Campaign) -> None:
    assert [empty.block_run_ids(block).tolist() for block in range(empty.block_count)] == [[10, 11], [12, 13], [14, 15]]


def test_finished_blocks_are_read_back_in_order(empty: Campaign) -> None:
    empty.write_block(2, synthetic_block(2), synthetic_timing())
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    read = Campaign(empty.directory)
    assert read.missing_blocks() == [1]
    assert read.run_ids.tolist() == [10, 11, 14]
    np.testing.assert_array_equal(read.metrics["min_range_m"], [0.0, np.nan, 4.0])
    np.testing.assert_array_equal(read.drawn["target.tumble_axis"][:, 1], [0.0, -1.0, -4.0])
    np.testing.assert_array_equal(read.failed_at_s, [np.nan, 12.0, np.nan])
    assert read.failure_reason.tolist() == ["", REASONS[2], ""]
    assert read.completed.tolist() == [True, False, True]
    assert read.traces["range_m"].dtype == np.float32


def test_a_run_that_is_not_judged_is_neither_completed_nor_failed(empty: Campaign) -> None:
    codes = np.array([Outcome.NOT_JUDGED.code, Outcome.UNFINISHED.code], np.int8)
    block = synthetic_block(0) | {"status/failure": codes, "status/failed_at_s": np.array([np.nan, 3.0])}
    empty.write_block(0, block, synthetic_timing())
    manifest = json.loads((empty.directory / "manifest" / "000000.json").read_text())
    expected = {"count": 2, "completed": 0, "failed": 1, "reasons": {"unfinished": 1}}
    assert manifest.items() >= expected.items()
    read = Campaign(empty.directory)
    assert read.outcomes.tolist() == ["not_judged", "unfinished"]
    assert (read.completed.tolist(), read.failed.tolist()) == ([False, False], [False, True])
    assert read.failure_reason.tolist() == ["", "unfinished"]
    counts = status(empty.directory)["runs"]
    assert (counts["completed"], counts["failed"], counts["not_judged"], counts["missing"]) == (0, 1, 1, 3)
    assert (counts["outcomes"]["not_judged"], counts["outcomes"]["unfinished"]) == (1, 1)


def test_padding_is_not_stored(empty: Campaign, arrays: Callable[[Path], dict[str, np.ndarray]]) -> None:
    for block in range(3):
        empty.write_block(block, synthetic_block(block), synthetic_timing())
    assert all(len(values) == 5 for values in arrays(empty.directory).values())
    manifest = json.loads((empty.directory / "manifest" / "000002.json").read_text())
    assert manifest.items() >= {"first": 4, "count": 1, "completed": 1, "failed": 0, "reasons": {}}.items()
    assert manifest["attempts"] == 1
    assert set(manifest["sha256"]) == {"metrics", "drawn", "traces", "status"}
    assert {"rpojax", "jax", "numpy", "zarr", "python"} == set(manifest["versions"])


def test_block_without_manifest_is_not_finished(empty: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(path: Path, content: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(atomic_files, "write_json", interrupt)
        with pytest.raises(KeyboardInterrupt):
            empty.write_block(0, synthetic_block(0), synthetic_timing())
    read = Campaign(empty.directory)
    assert read.missing_blocks() == [0, 1, 2]
    assert read.metrics == {}
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    assert read.metrics["min_range_m"][0] == 0.0


def test_stored_scenario_loads_to_the_same(empty: Campaign, mission: ScenarioFile) -> None:
    assert scenario_loader.load(empty.directory / "scenario.toml") == mission


def test_history_is_read_back_and_can_be_rewritten(empty: Campaign) -> None:
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
    for _ in range(2):  # another process may have removed it
        empty.remove_history(10)
    assert empty.history_ids == []
    empty.write_history(10, channels)
    np.testing.assert_array_equal(empty.history(10)["time_s"], channels["time_s"])


def test_writer_stops_if_its_campaign_was_replaced(mission: ScenarioFile, tmp_path: Path) -> None:
    before = empty_campaign(tmp_path / "runs", mission, 7, 5, 0, 2)
    before.write_block(0, synthetic_block(0), synthetic_timing())
    after = empty_campaign(tmp_path / "runs", mission, 8, 5, 0, 2, force=True)
    with pytest.raises(UnfinishedError, match="found another campaign"):
        before.write_block(1, synthetic_block(1), synthetic_timing())
    assert after.missing_blocks() == list(range(after.block_count))


def test_blocks_of_an_older_version_are_read_beside_those_of_this_one(empty: Campaign) -> None:
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    assert empty.events == []
    newer = synthetic_block(1) | {
        "metrics/delta_v_m_s": np.array([0.5, np.nan]),
        "events/count": np.array([1, 0], np.int32),
        "events/code": np.array([[Outcome.LOST.code, 0], [0, 0]], np.int8),
        "events/raised_at_s": np.array([[600.0, np.nan], [np.nan, np.nan]]),
        "events/cleared_at_s": np.array([[700.0, np.nan], [np.nan, np.nan]]),
    }
    empty.write_block(1, newer, synthetic_timing())
    found = Campaign(empty.directory)
    assert found.outcomes.tolist() == ["completed", "keep_out"] * 2
    assert found.is_judged.tolist() == [False, False, True, True]
    np.testing.assert_array_equal(found.metrics["delta_v_m_s"], [np.nan, np.nan, 0.5, np.nan])
    (event,) = found.events
    assert (event.run_id, event.outcome) == (int(found.run_ids[2]), Outcome.LOST)
    assert (event.raised_at_s, event.cleared_at_s) == (600.0, 700.0)
    missing = next((empty.directory / "results.zarr" / "events" / "code").rglob("c/1/0"))
    missing.unlink()
    with pytest.raises(ResultError, match="code/c/1/0: missing, expected the values of block"):
        _ = Campaign(empty.directory).events


def test_a_servicer_of_a_team_is_named_or_numbered() -> None:
    team = SimpleNamespace(servicer_names=("near", "far"))
    given = ("far", 1, 0, np.int64(1))
    assert [Campaign.servicer_number(team, one) for one in given] == [1, 1, 0, 1]  # pyright: ignore[reportArgumentType]
    for one in ("third", 2, -1, True):
        with pytest.raises(
            ResultError, match=r"^servicer: found .*, expected one of near, far, or a number from 0 to 1$"
        ):
            Campaign.servicer_number(team, one)  # pyright: ignore[reportArgumentType]
