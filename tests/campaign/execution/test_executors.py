"""Workers that die lose their blocks only, which others do; blocks that kill are given up."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing

from rpojax.campaign.execution import block_runner, dask_executor, process_executor
from rpojax.campaign.execution.process_executor import ProcessExecutor
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError, UnfinishedError
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
        tries = len((folder / str(block)).read_text())
        if {behaviour!r} == "full":
            print(json.dumps(["error", "UnfinishedError", "found no space"]), flush=True)
            sys.exit()
        if block == 2 and ({behaviour!r} == "poison" or tries < 3):
            print("what a mess", file=sys.stderr, flush=True)
            os.kill(os.getpid(), 9)
    print(json.dumps(["progress", 0.5, 0]), flush=True)
    print(json.dumps(["done", len(blocks)]), flush=True)
"""


@pytest.fixture
def campaign(mission: ScenarioFile, tmp_path: Path) -> Campaign:
    """Eleven runs in six blocks."""
    return empty_campaign(tmp_path / "runs", mission, 7, 11, 0, 2)


@pytest.fixture
def tries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder in which stand-ins for workers, two on two cores each, note every try at a block."""
    folder = tmp_path / "tries"
    folder.mkdir()
    monkeypatch.setattr(process_executor, "_available_cores", lambda: {0, 1, 2, 3})
    return folder


def behave(monkeypatch: pytest.MonkeyPatch, folder: Path, behaviour: str) -> None:
    """Has a stand-in of a certain behaviour started for every worker."""
    popen = process_executor.subprocess.Popen

    def start(words: Sequence[str], **settings: Any) -> Any:
        assert "--xla_force_host_platform_device_count=2" in settings["env"]["XLA_FLAGS"]
        return popen([sys.executable, "-c", WORKER.format(folder=str(folder), behaviour=behaviour)], **settings)

    monkeypatch.setattr(process_executor.subprocess, "Popen", start)


def tried(folder: Path) -> dict[int, int]:
    return {int(path.name): len(path.read_text()) for path in folder.iterdir()}


def test_blocks_of_a_worker_that_dies_are_done_by_another(
    campaign: Campaign, tries: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    behave(monkeypatch, tries, "clumsy")
    told: list[tuple[float, int, bool]] = []
    assert ProcessExecutor(campaign, 2).run_blocks(range(6), lambda *words: told.append(words)) == {}
    counts = tried(tries)
    assert counts[2] == 3
    assert set(counts) == set(range(6))
    assert sum(counts.values()) <= 6 + 2 + 1  # two more tries of block 2, and one of its neighbour
    assert told[0] == (0.0, 0, False)
    assert told[-1] == (11.0, 6, True)


def test_a_block_that_kills_three_workers_is_given_up_and_the_others_are_done(
    campaign: Campaign, tries: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    behave(monkeypatch, tries, "poison")
    given_up = ProcessExecutor(campaign, 2).run_blocks(range(6), lambda *_: None)
    assert given_up.keys() == {2}
    assert "signal 9: what a mess" in given_up[2]
    counts = tried(tries)
    assert counts[2] == 3
    assert set(counts) == set(range(6))


def test_an_error_that_no_other_worker_could_avoid_ends_the_campaign(
    campaign: Campaign, tries: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    behave(monkeypatch, tries, "full")
    with pytest.raises(UnfinishedError, match="found no space"):
        ProcessExecutor(campaign, 2).run_blocks(range(6), lambda *_: None)
    assert sum(tried(tries).values()) <= 2


def test_cores_are_shared_out_evenly() -> None:
    assert process_executor.split_cores([0, 1, 2, 3, 4], 2) == [[0, 2, 4], [1, 3]]
    assert process_executor.split_cores([4, 5], 2) == [[4], [5]]
    assert process_executor.split_cores([4, 5], 3) == [[4], [5], [4]]


def test_a_cluster_does_blocks_into_the_folder(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    tries: dict[int, int] = {}

    def do(result: Campaign, engine: None, wave: Sequence[int], during: block_runner.BatchProgressCallback) -> int:
        tries[wave[0]] = tries.get(wave[0], 0) + 1
        if wave[0] == 2 or (wave[0] == 1 and tries[1] < 3):
            raise MemoryError("too little")
        result.write_block(wave[0], synthetic_block(wave[0]), synthetic_timing())
        return 1

    monkeypatch.setattr(block_runner, "simulate_and_store", do)
    monkeypatch.setattr(dask_executor, "_campaign_and_engine", lambda directory, _: (Campaign(directory), None))
    told: list[tuple[float, int, bool]] = []
    settings = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(**settings) as local:
        spread = dask_executor.DaskExecutor(campaign, local.scheduler_address)
        assert spread.run_blocks(range(6), lambda *words: told.append(words)) == {2: "too little"}
    assert campaign.missing_blocks() == [2]
    assert tries == {0: 1, 1: 3, 2: 3, 3: 1, 4: 1, 5: 1}
    assert told[-1] == (9.0, 5, True)


@pytest.mark.parametrize("own", [None, "--xla_own=1"])
def test_a_worker_computes_as_it_is_told_unless_it_knows_better(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch, own: str | None
) -> None:
    monkeypatch.setattr(block_runner, "simulate_and_store", lambda *_: 0)
    monkeypatch.setattr(dask_executor, "_campaign_and_engine", lambda directory, _: (Campaign(directory), None))
    monkeypatch.setenv("XLA_FLAGS", own or "")
    if own is None:
        monkeypatch.delenv("XLA_FLAGS")
    assert dask_executor.simulate_block(str(campaign.directory), 0, {"XLA_FLAGS": "--xla_told=1"}) == ("done", 0)
    assert os.environ["XLA_FLAGS"] == (own or "--xla_told=1")


def test_a_worker_understands_all_that_it_may_be_told(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(block_runner, "simulate_and_store", lambda *_: 0)
    monkeypatch.setattr(dask_executor, "_campaign_and_engine", lambda directory, _: (Campaign(directory), None))
    heard: dict[str, object] = {}
    monkeypatch.setattr(dask_executor.jax.config, "update", heard.__setitem__)
    told = dict.fromkeys(dask_executor._FORWARDED_VARIABLES, "7")
    for name in told:
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    assert dask_executor.simulate_block(str(campaign.directory), 0, told) == ("done", 0)
    assert (os.environ["XLA_FLAGS"], os.environ["RPOJAX_TRACES"]) == ("7", "7")
    assert heard == {
        "jax_compilation_cache_dir": "7",
        "jax_persistent_cache_min_compile_time_secs": 7.0,
        "jax_persistent_cache_min_entry_size_bytes": 7,
    }
    for name in ("XLA_FLAGS", "RPOJAX_TRACES"):
        monkeypatch.delenv(name)


def test_a_scheduler_that_is_not_there_is_named(campaign: Campaign) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(RpojaxError, match=r"--scheduler: found 'nonsense://x'.*expected the address"):
        dask_executor.DaskExecutor(campaign, "nonsense://x").run_blocks([0], lambda *_: None)
