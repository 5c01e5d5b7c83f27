"""Files of finished blocks that are missing or cut short: status tells them, and a resume runs the blocks again."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from empty_campaign_folders import synthetic_block, synthetic_timing

from rpojax.campaign.options.campaign_options import Shard
from rpojax.campaign.run_and_resume import release_lost
from rpojax.campaign.status import status
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError
from rpojax.simulation.outcomes.outcome_kinds import Outcome


@pytest.fixture
def finished(empty: Campaign) -> Campaign:
    """Three finished blocks, of which the last one has a history."""
    for block in range(3):
        empty.write_block(block, synthetic_block(block), synthetic_timing())
    empty.write_history(14, {"time_s": np.arange(4.0), "rho_H": np.zeros((4, 3))})
    return Campaign(empty.directory)


def cut(path: Path) -> None:
    """Leaves all but the last byte of a file."""
    path.write_bytes(path.read_bytes()[:-1])


@pytest.mark.parametrize(
    ("name", "block", "damage", "words"),
    [
        ("metrics/min_range_m/c/1", 1, Path.unlink, "missing"),
        ("metrics/min_range_m/c/1", 1, cut, "cut short"),
        ("traces/range_m/c/2/0", 2, cut, "cut short"),
        ("traces/range_m/c/0/0", 0, lambda path: path.write_bytes(b""), "cut short"),
        ("histories/14/rho_H/c/0/0", 2, cut, "cut short"),
        ("histories/14/time_s/c/0", 2, Path.unlink, "missing"),
    ],
)
def test_a_lost_file_makes_its_block_unfinished(
    finished: Campaign, name: str, block: int, damage: Callable[[Path], object], words: str
) -> None:
    place = finished.directory / "results.zarr" / name
    assert status(finished.directory)["lost"] == []
    damage(place)
    found = status(finished.directory)
    assert found["lost"] == [{"block": block, "file": str(place), "found": words}]
    assert found["blocks"] == {"total": 3, "done": 2, "missing": 1}
    assert found["runs"]["missing"] == finished.configuration.runs_in_block(block)
    assert [str(file.path) for file in release_lost(finished, Shard(1 + (block + 1) % 3, 3))] == []
    with pytest.raises(ResultError):
        Campaign(finished.directory).verify()
    assert [file.path for file in release_lost(finished, Shard(1 + block, 3))] == [place]
    read = Campaign(finished.directory)
    assert read.missing_blocks() == [block]
    read.verify()
    read.write_block(block, synthetic_block(block), synthetic_timing())
    assert status(finished.directory)["lost"] == []
    assert len(Campaign(finished.directory).metrics["min_range_m"]) == 5


@pytest.mark.parametrize("name", ["metrics", "metrics/min_range_m/zarr.json"])
def test_a_lost_group_makes_all_its_blocks_unfinished(finished: Campaign, name: str) -> None:
    place = finished.directory / "results.zarr" / name
    place.unlink() if place.is_file() else shutil.rmtree(place)
    assert [entry["block"] for entry in status(finished.directory)["lost"]] == [0, 1, 2]


def test_arrays_that_an_older_version_did_not_know_are_not_lost(finished: Campaign) -> None:
    events = {"events/count": np.zeros(2, np.int32), "events/code": np.full((2, 1), Outcome.LOST.code, np.int8)}
    more = synthetic_block(1) | events | {"metrics/delta_v_m_s": np.ones(2)}
    finished.write_block(1, more, synthetic_timing())
    assert status(finished.directory)["lost"] == []
    next((finished.directory / "results.zarr" / "metrics" / "delta_v_m_s").rglob("c/1")).unlink()
    assert [entry["block"] for entry in status(finished.directory)["lost"]] == [1]


def test_changed_values_are_refused_and_never_simulated_again(finished: Campaign) -> None:
    place = finished.directory / "results.zarr" / "metrics" / "min_range_m" / "c" / "1"
    place.write_bytes(place.read_bytes()[::-1])
    assert release_lost(finished) == []
    with pytest.raises(ResultError, match="found other values in block 1"):
        Campaign(finished.directory).verify()


def test_a_released_block_without_its_history_is_resumed_after_a_kill(finished: Campaign) -> None:
    cut(finished.directory / "results.zarr" / "histories" / "14" / "rho_H" / "c" / "0" / "0")
    (finished.directory / "manifest" / "000002.json").unlink()
    assert release_lost(finished) == []
    Campaign(finished.directory).verify()
    assert Campaign(finished.directory).history_ids == []
