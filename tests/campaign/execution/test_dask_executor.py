"""Blocks simulated by the workers of a Dask cluster."""

import os
from collections.abc import Sequence
from pathlib import Path

import jax
import pytest
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing

from rpojax.campaign.execution import block_runner, dask_executor
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError
from rpojax.runtime import jax_configuration
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture
def campaign(mission: ScenarioFile, tmp_path: Path) -> Campaign:
    """Eleven runs in six blocks."""
    return empty_campaign(tmp_path / "runs", mission, 7, 11, 0, 2)


def test_cluster_stores_blocks_in_the_folder(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    attempts: dict[int, int] = {}

    def simulate(
        campaign: Campaign, engine: None, blocks: Sequence[int], on_progress: block_runner.BatchProgressCallback
    ) -> int:
        (block,) = blocks
        attempts[block] = attempts.get(block, 0) + 1
        if block == 2 or (block == 1 and attempts[1] < 3):
            raise MemoryError("too little")
        campaign.write_block(block, synthetic_block(block), synthetic_timing())
        return 1

    monkeypatch.setattr(block_runner, "simulate_and_store", simulate)
    monkeypatch.setattr(dask_executor, "_campaign_and_engine", lambda directory, _: (Campaign(directory), None))
    reported: list[tuple[float, int, bool]] = []
    settings = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(**settings) as local:
        executor = dask_executor.DaskExecutor(campaign, local.scheduler_address)
        assert executor.run_blocks(range(6), lambda *progress: reported.append(progress)) == {2: "too little"}
    assert campaign.missing_blocks() == [2]
    assert attempts == {0: 1, 1: 3, 2: 3, 3: 1, 4: 1, 5: 1}
    assert reported[-1] == (9.0, 5, True)


@pytest.mark.parametrize("own", [None, "--xla_own=1"])
def test_forwarded_flags_do_not_override_those_of_a_worker(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch, own: str | None
) -> None:
    monkeypatch.setattr(block_runner, "simulate_and_store", lambda *_: 0)
    monkeypatch.setattr(dask_executor, "_campaign_and_engine", lambda directory, _: (Campaign(directory), None))
    monkeypatch.setenv("XLA_FLAGS", own or "")
    if own is None:
        monkeypatch.delenv("XLA_FLAGS")
    assert dask_executor.simulate_block(str(campaign.directory), 0, {"XLA_FLAGS": "--xla_forwarded=1"}) == ("done", 0)
    assert os.environ["XLA_FLAGS"] == (own or "--xla_forwarded=1")


def test_worker_applies_all_forwarded_variables(campaign: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(block_runner, "simulate_and_store", lambda *_: 0)
    monkeypatch.setattr(dask_executor, "_campaign_and_engine", lambda directory, _: (Campaign(directory), None))
    updated: dict[str, object] = {}
    monkeypatch.setattr(jax.config, "update", updated.__setitem__)
    environment = dict.fromkeys(jax_configuration._SENT_VARIABLES, "7")
    for name in environment:
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    assert dask_executor.simulate_block(str(campaign.directory), 0, environment) == ("done", 0)
    assert os.environ["XLA_FLAGS"] == "7"
    assert updated == {
        "jax_compilation_cache_dir": "7",
        "jax_persistent_cache_min_compile_time_secs": 7.0,
        "jax_persistent_cache_min_entry_size_bytes": 7,
    }
    monkeypatch.delenv("XLA_FLAGS")


def test_unreachable_scheduler_is_named(campaign: Campaign) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(RpojaxError, match=r"scheduler: found 'nonsense://x'.*expected the address"):
        dask_executor.DaskExecutor(campaign, "nonsense://x").run_blocks([0], lambda *_: None)
