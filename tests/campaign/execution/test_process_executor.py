"""Blocks of worker processes that die are repeated by others; blocks that kill workers are given up."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from empty_campaign_folders import empty_campaign

from rpojax.campaign.execution import process_executor
from rpojax.campaign.execution.process_executor import ProcessExecutor
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import UnfinishedError
from rpojax.scenario.schema import ScenarioFile

WORKER = """
import json, os, pathlib, sys
folder = pathlib.Path({folder!r})
print(json.dumps(["ready"]), flush=True)
for line in sys.stdin:
    blocks = json.loads(line)
    for block in blocks:
        with (folder / str(block)).open("a") as stream:
            stream.write("x")
        attempt = len((folder / str(block)).read_text())
        if {behaviour!r} == "full":
            print(json.dumps(["error", "UnfinishedError", "found no space"]), flush=True)
            sys.exit()
        if block == 2 and ({behaviour!r} == "deadly" or attempt < 3):
            print("out of luck", file=sys.stderr, flush=True)
            os.kill(os.getpid(), 9)
    print(json.dumps(["progress", 0.5, 0]), flush=True)
    print(json.dumps(["done", len(blocks)]), flush=True)
"""


@pytest.fixture
def campaign(mission: ScenarioFile, tmp_path: Path) -> Campaign:
    """Eleven runs in six blocks."""
    return empty_campaign(tmp_path / "runs", mission, 7, 11, 0, 2)


@pytest.fixture
def attempts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder in which stand-ins for two workers on two cores each record every attempt at a block."""
    folder = tmp_path / "attempts"
    folder.mkdir()
    monkeypatch.setattr(process_executor, "_available_cores", lambda: {0, 1, 2, 3})
    return folder


def start_stand_ins(monkeypatch: pytest.MonkeyPatch, folder: Path, behaviour: str) -> None:
    """Replaces every worker by a stand-in of a given behaviour."""
    popen = process_executor.subprocess.Popen

    def start(words: Sequence[str], **settings: Any) -> Any:
        assert "--xla_force_host_platform_device_count=2" in settings["env"]["XLA_FLAGS"]
        return popen([sys.executable, "-c", WORKER.format(folder=str(folder), behaviour=behaviour)], **settings)

    monkeypatch.setattr(process_executor.subprocess, "Popen", start)


def count_attempts(folder: Path) -> dict[int, int]:
    return {int(path.name): len(path.read_text()) for path in folder.iterdir()}


def test_blocks_of_a_dead_worker_are_repeated(
    campaign: Campaign, attempts: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start_stand_ins(monkeypatch, attempts, "unreliable")
    reported: list[tuple[float, int, bool]] = []
    assert ProcessExecutor(campaign, 2).run_blocks(range(6), lambda *progress: reported.append(progress)) == {}
    counts = count_attempts(attempts)
    assert counts[2] == 3
    assert set(counts) == set(range(6))
    assert sum(counts.values()) <= 6 + 2 + 1  # two more attempts at block 2, and one at its neighbour
    assert reported[0] == (0.0, 0, False)
    assert reported[-1] == (11.0, 6, True)


def test_block_that_kills_three_workers_is_given_up(
    campaign: Campaign, attempts: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start_stand_ins(monkeypatch, attempts, "deadly")
    given_up = ProcessExecutor(campaign, 2).run_blocks(range(6), lambda *_: None)
    assert given_up.keys() == {2}
    assert "signal 9: out of luck" in given_up[2]
    counts = count_attempts(attempts)
    assert counts[2] == 3
    assert set(counts) == set(range(6))


def test_error_that_no_repetition_avoids_ends_the_campaign(
    campaign: Campaign, attempts: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start_stand_ins(monkeypatch, attempts, "full")
    with pytest.raises(UnfinishedError, match="found no space"):
        ProcessExecutor(campaign, 2).run_blocks(range(6), lambda *_: None)
    assert sum(count_attempts(attempts).values()) <= 2


def test_cores_are_split_evenly() -> None:
    assert process_executor.split_cores([0, 1, 2, 3, 4], 2) == [[0, 2, 4], [1, 3]]
    assert process_executor.split_cores([4, 5], 2) == [[4], [5]]
    assert process_executor.split_cores([4, 5], 3) == [[4], [5], [4]]
