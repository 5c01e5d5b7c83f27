"""Writing of Zarr arrays by several processes, of which some are killed."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np
import pytest
import zarr
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing

import rpojax
from rpojax.campaign.storage import atomic_files, folder_creation
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import UnfinishedError
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
for block in itertools.cycle(blocks) if sys.argv[2] == "repeatedly" else reversed(blocks):
    campaign.write_block(block, synthetic_block(block), synthetic_timing())
    print(block, flush=True)
"""


def start_writer(directory: Path, how: str) -> subprocess.Popen[str]:
    """Process that writes the missing blocks, repeatedly or once in reverse order, and prints the number of each."""
    code = WRITER.format(tests=str(Path(__file__).parents[3]))
    path = {"PYTHONPATH": str(Path(rpojax.__file__).parents[1])}
    words = [sys.executable, "-c", code, str(directory), how]
    return subprocess.Popen(words, env=os.environ | path, stdout=subprocess.PIPE, text=True)


def test_two_writers_one_killed_leave_what_a_single_writer_leaves(
    mission: ScenarioFile, tmp_path: Path, arrays: Callable[[Path], dict[str, np.ndarray]]
) -> None:
    shared = empty_campaign(tmp_path / "shared", mission, 7, RUNS, 0, BLOCK)
    alone = empty_campaign(tmp_path / "alone", mission, 7, RUNS, 0, BLOCK)
    for block in range(alone.block_count):
        alone.write_block(block, synthetic_block(block), synthetic_timing())

    # The arrays do not exist yet.
    killed, other = start_writer(shared.directory, "repeatedly"), start_writer(shared.directory, "once")
    assert killed.stdout
    for _ in range(3):
        killed.stdout.readline()
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    other.communicate()
    assert (killed.returncode, other.returncode) == (-signal.SIGKILL, 0)
    assert shared.missing_blocks() == []
    folder_creation.remove_stale_files(shared.directory)
    assert list(shared.directory.rglob("*.partial")) == []
    found, expected = contents(shared.directory / "results.zarr"), contents(alone.directory / "results.zarr")
    assert found == expected
    np.testing.assert_array_equal(shared.metrics["min_range_m"], arrays(alone.directory)["metrics/min_range_m"])


def test_what_says_that_files_are_complete_is_written_after_they_are_on_the_disk(
    tmp_path: Path, mission: ScenarioFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = empty_campaign(tmp_path / "campaign", mission, 7, RUNS, 0, BLOCK)
    arrays = campaign.directory / "results.zarr"

    def refuse(paths: Collection[Path]) -> None:
        flushed.append(sorted(path.relative_to(arrays).parts[0] for path in paths))
        raise UnfinishedError("found no room")

    flushed: list[list[str]] = []
    for write in (
        lambda: campaign.write_history(3, {"time_s": np.arange(4.0)}),
        lambda: campaign.write_block(0, synthetic_block(0), synthetic_timing()),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(atomic_files, "flush", refuse)
            with pytest.raises(UnfinishedError):
                write()
    assert "histories" in flushed[0]
    assert {"metrics", "status"} <= set(flushed[1])
    assert (arrays / "histories/3/time_s/zarr.json").is_file()
    assert not (arrays / "histories/3/zarr.json").exists()
    assert 0 in campaign.missing_blocks()

    campaign.write_history(3, {"time_s": np.arange(4.0)})
    campaign.write_block(0, synthetic_block(0), synthetic_timing())
    assert list(campaign.history_ids) == [3]
    assert 0 not in campaign.missing_blocks()
    assert not campaign._writer._unflushed


def contents(directory: Path) -> dict[str, bytes]:
    """Path in the folder -> content of every file."""
    return {str(path.relative_to(directory)): path.read_bytes() for path in directory.rglob("*") if path.is_file()}


def test_truncated_shard_of_an_unfinished_block_is_rewritten(mission: ScenarioFile, tmp_path: Path) -> None:
    campaign = empty_campaign(tmp_path / "runs", mission, 7, 5, 0, BLOCK)
    for block in range(2):
        campaign.write_block(block, synthetic_block(block), synthetic_timing())
    (campaign.directory / "manifest" / "000001.json").unlink()
    torn = campaign.directory / "results.zarr" / "traces" / "range_m" / "c" / "1" / "0"
    whole = torn.read_bytes()
    torn.write_bytes(whole[: len(whole) // 2])
    assert Campaign(campaign.directory).traces["range_m"].shape == (2, 3)
    Campaign(campaign.directory).write_block(1, synthetic_block(1), synthetic_timing())
    assert torn.read_bytes() == whole
    assert Campaign(campaign.directory).traces["range_m"].shape == (4, 3)


def test_time_series_are_sharded_and_dimensions_named(mission: ScenarioFile, tmp_path: Path) -> None:
    campaign = empty_campaign(tmp_path / "runs", mission, 7, 240, 0, 120)
    long = {name: np.repeat(values, 60, axis=0) for name, values in synthetic_block(0).items()}
    campaign.write_block(1, long, synthetic_timing())
    root = zarr.open_group(str(campaign.directory / "results.zarr"), mode="r")
    found = {name: node for name, node in root.members(max_depth=None) if isinstance(node, zarr.Array)}
    layouts = {name: (node.shards, node.chunks, node.metadata.dimension_names) for name, node in found.items()}
    assert layouts["traces/range_m"] == ((120, 3), (60, 3), ("run", "time"))
    assert layouts["drawn/target.tumble_axis"] == (None, (120, 3), ("run", "axis1_3"))
    assert layouts["metrics/min_range_m"] == (None, (120,), ("run",))
    assert found["metrics/min_range_m"].attrs["units"] == "m"
    assert np.isnan(np.asarray(found["traces/range_m"][:120])).all()
