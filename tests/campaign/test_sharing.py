"""Several processes at one folder: kills cost the blocks under way, and two at one block write the same bytes."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zarr
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing

import rpojax
from rpojax.campaign import rerun
from rpojax.campaign.execution.campaign_engine import check_versions
from rpojax.campaign.history_retention import Retention
from rpojax.campaign.job_shard import Shard
from rpojax.campaign.run_and_resume import resume_campaign
from rpojax.campaign.storage import atomic_files, folder_creation, stale_files
from rpojax.campaign.storage.campaign_configuration import new_configuration, package_versions
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import OutputError, ResultError, RpojaxError, UnfinishedError
from rpojax.scenario.schema import ScenarioFile

RUNS, BLOCK = 60, 2

WRITER = """
import itertools
import sys
sys.path.insert(0, {tests!r})
from empty_campaign_folders import synthetic_block, synthetic_timing
from rpojax.campaign.storage.campaign_folder import Campaign

campaign = Campaign(sys.argv[1])
blocks = campaign.missing_blocks()
for block in itertools.cycle(blocks) if sys.argv[2] == "endlessly" else reversed(blocks):
    campaign.write_block(block, synthetic_block(block), synthetic_timing())
    print(block, flush=True)
"""


def writer(directory: Path, how: str) -> subprocess.Popen[str]:
    """A process that writes the missing blocks, over and over or once from the last on, and tells each."""
    code = WRITER.format(tests=str(Path(__file__).parents[1]))
    path = {"PYTHONPATH": str(Path(rpojax.__file__).parents[1])}
    words = [sys.executable, "-c", code, str(directory), how]
    return subprocess.Popen(words, env=os.environ | path, stdout=subprocess.PIPE, text=True)


def test_two_writers_of_all_blocks_one_of_them_killed_leave_what_one_alone_leaves(
    mission: ScenarioFile, tmp_path: Path, arrays: Callable[[Path], dict[str, np.ndarray]]
) -> None:
    shared = empty_campaign(tmp_path / "shared", mission, 7, RUNS, 0, BLOCK)
    alone = empty_campaign(tmp_path / "alone", mission, 7, RUNS, 0, BLOCK)
    for block in range(alone.block_count):
        alone.write_block(block, synthetic_block(block), synthetic_timing())

    # When they begin, not even the arrays are there.
    killed, other = writer(shared.directory, "endlessly"), writer(shared.directory, "once")
    assert killed.stdout
    for _ in range(3):
        killed.stdout.readline()
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    other.communicate()
    assert (killed.returncode, other.returncode) == (-signal.SIGKILL, 0)
    assert shared.missing_blocks() == []
    stale_files.remove_stale_files(shared.directory)
    assert list(shared.directory.rglob("*.partial")) == []
    found, expected = contents(shared.directory / "results.zarr"), contents(alone.directory / "results.zarr")
    assert found == expected
    np.testing.assert_array_equal(shared.metrics["min_range_m"], arrays(alone.directory)["metrics/min_range_m"])


def contents(directory: Path) -> dict[str, bytes]:
    """Every file of a folder, by its path in it."""
    return {str(path.relative_to(directory)): path.read_bytes() for path in directory.rglob("*") if path.is_file()}


def test_a_torn_shard_of_an_unfinished_block_does_no_harm_and_is_written_anew(
    mission: ScenarioFile, tmp_path: Path
) -> None:
    made = empty_campaign(tmp_path / "runs", mission, 7, 5, 0, BLOCK)
    for block in range(2):
        made.write_block(block, synthetic_block(block), synthetic_timing())
    (made.directory / "manifest" / "000001.json").unlink()
    torn = made.directory / "results.zarr" / "traces" / "range_m" / "c" / "1" / "0"
    whole = torn.read_bytes()
    torn.write_bytes(whole[: len(whole) // 2])
    assert Campaign(made.directory).traces["range_m"].shape == (2, 3)
    Campaign(made.directory).write_block(1, synthetic_block(1), synthetic_timing())
    assert torn.read_bytes() == whole
    assert Campaign(made.directory).traces["range_m"].shape == (4, 3)


def test_rows_of_more_than_one_sample_are_in_shards_with_named_dimensions(
    mission: ScenarioFile, tmp_path: Path
) -> None:
    made = empty_campaign(tmp_path / "runs", mission, 7, 240, 0, 120)
    long = {name: np.repeat(values, 60, axis=0) for name, values in synthetic_block(0).items()}
    made.write_block(1, long, synthetic_timing())
    root = zarr.open_group(str(made.directory / "results.zarr"), mode="r")
    found = {name: node for name, node in root.members(max_depth=None) if isinstance(node, zarr.Array)}
    layouts = {name: (node.shards, node.chunks, node.metadata.dimension_names) for name, node in found.items()}
    assert layouts["traces/range_m"] == ((120, 3), (60, 3), ("run", "time"))
    assert layouts["drawn/target.tumble_axis"] == (None, (120, 3), ("run", "axis1_3"))
    assert layouts["metrics/min_range_m"] == (None, (120,), ("run",))
    assert found["metrics/min_range_m"].attrs["units"] == "m"
    assert np.isnan(np.asarray(found["traces/range_m"][:120])).all()


def asked(mission: ScenarioFile, seed: int = 7) -> dict[str, object]:
    return new_configuration(mission, seed, 5, 0, BLOCK, {"rule": "none", "channels": None, "every": 1})


def test_the_first_to_come_makes_the_folder_and_others_join_if_they_agree(
    mission: ScenarioFile, tmp_path: Path
) -> None:
    out = tmp_path / "runs"
    folder_creation.join_folder(out, asked(mission))
    before = (out / "campaign.json").read_bytes()
    folder_creation.join_folder(out, asked(mission))
    assert (out / "campaign.json").read_bytes() == before
    with pytest.raises(ResultError, match="found seed 7, expected 8 to share the folder"):
        folder_creation.join_folder(out, asked(mission, seed=8))
    with pytest.raises(OutputError, match="--force"):
        folder_creation.create_folder(out, asked(mission), force=False)
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


def test_who_comes_second_by_a_hair_joins_too_and_leaves_nothing(
    mission: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "runs"
    folder_creation.join_folder(out, asked(mission))
    # As if the folder had come between the look and the rename.
    monkeypatch.setattr(os.path, "lexists", lambda path: Path(path) != out and Path(path).exists())
    monkeypatch.setattr(folder_creation, "_try_rename", lambda made, place: False)
    folder_creation.join_folder(out, asked(mission))
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


def test_what_a_maker_left_that_was_killed_goes_when_the_folder_is_made(mission: ScenarioFile, tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    left = tmp_path / f".runs.{atomic_files.machine_id()}-{process.pid}-0.partial"
    left.mkdir()
    (left / "scenario.toml").touch()
    folder_creation.create_folder(tmp_path / "runs", asked(mission), force=False)
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b", "1/0", "-1/2", "1/2/3", ""])
def test_a_shard_that_makes_no_sense_is_refused(text: str) -> None:
    with pytest.raises(RpojaxError, match=r"--shard: found .*expected i/n"):
        Shard.parse(text)


def test_shards_have_every_block_once() -> None:
    parts = [Shard.parse(f"{number}/3").select(range(10)) for number in (1, 2, 3)]
    assert parts[0] == [0, 3, 6, 9]
    assert sorted(block for part in parts for block in part) == list(range(10))


def test_a_writer_whose_folder_was_taken_by_another_campaign_writes_nothing_more(
    mission: ScenarioFile, tmp_path: Path
) -> None:
    before = empty_campaign(tmp_path / "runs", mission, 7, RUNS, 0, BLOCK)
    before.write_block(0, synthetic_block(0), synthetic_timing())
    after = empty_campaign(tmp_path / "runs", mission, 8, RUNS, 0, BLOCK, force=True)
    with pytest.raises(UnfinishedError, match="found another campaign"):
        before.write_block(1, synthetic_block(1), synthetic_timing())
    assert after.missing_blocks() == list(range(after.block_count))


def test_a_manifest_of_another_campaign_is_refused(mission: ScenarioFile, tmp_path: Path) -> None:
    one = empty_campaign(tmp_path / "one", mission, 7, RUNS, 0, BLOCK)
    other = empty_campaign(tmp_path / "other", mission, 7, RUNS, 0, BLOCK)
    one.write_block(0, synthetic_block(0), synthetic_timing())
    (other.directory / "manifest").mkdir()
    shutil.copy(one.directory / "manifest" / "000000.json", other.directory / "manifest")
    with pytest.raises(ResultError, match="found campaign"):
        _ = other.manifests


def test_a_shard_with_nothing_left_leaves_the_second_pass_to_the_last_one(
    mission: ScenarioFile, tmp_path: Path
) -> None:
    kept = Retention("worst:1:min_range_m")
    asked = new_configuration(mission, 0, 4, 0, 2, kept.to_record())
    folder_creation.create_folder(tmp_path / "runs", asked, force=False)
    assert resume_campaign(tmp_path / "runs", shard=Shard.parse("3/3")).missing_blocks() == [0, 1]


def test_blocks_are_not_added_with_another_version() -> None:
    with pytest.raises(RpojaxError, match=r"jax: found version .*, expected 0\.1\.2, with which the campaign began"):
        check_versions(package_versions() | {"jax": "0.1.2"})


def test_a_run_is_not_flown_again_onto_its_own_campaign(mission: ScenarioFile, tmp_path: Path) -> None:
    found = empty_campaign(tmp_path / "runs", mission, 7, RUNS, 0, BLOCK)
    for place in (tmp_path / "runs", tmp_path):
        with pytest.raises(OutputError, match="where the campaign itself is"):
            rerun.rerun(found, 0, place, force=True)
    assert (tmp_path / "runs" / "campaign.json").is_file()
