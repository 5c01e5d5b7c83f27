"""One trace for a campaign, and numbers of a run that depend on nothing but scenario, seed and run number."""

import itertools
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import fast_compile_flags
import jax
import numpy as np
import pytest

import rpojax
from rpojax.campaign.execution import batch_engine
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.run_and_resume import run_campaign
from rpojax.runtime import device_programs, trace_cache
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import initial_state
from rpojax.simulation.step import step

BATCH = 64
OTHER_BLOCK_SIZE = {"rtol": 1e-5, "atol": 1e-5}
"""Programs for different block sizes round differently; in 400 s that stays far below what single precision shows."""

Channels = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def engine(mission: ScenarioFile) -> BatchEngine:
    """One device that takes `BATCH` runs."""
    engine = BatchEngine(mission, BATCH, jax.devices()[:1])
    engine.compile()
    return engine


def fly(engine: BatchEngine, ids: Sequence[int] | np.ndarray) -> Channels:
    """All channels (ticks, runs, ...) of the given runs."""
    segments = list(engine.simulate(engine.prepare(0, np.asarray(ids))))
    assert [segment.first_tick for segment in segments] == [0, 200]
    return {name: np.concatenate([segment.channels[name] for segment in segments]) for name in segments[0].channels}


@pytest.fixture(scope="module")
def block(engine: BatchEngine) -> Channels:
    """Runs 0 to 63, in order."""
    return fly(engine, np.arange(BATCH))


def same(first: Channels, column: int, second: Channels, other: int) -> list[str]:
    """Channels in which two runs differ in any bit."""
    return [
        name
        for name in first
        if not np.array_equal(first[name][:, column], second[name][:, other], equal_nan=first[name].dtype.kind == "f")
    ]


def test_a_run_is_the_same_to_the_last_bit_alone_and_anywhere_in_a_block(engine: BatchEngine, block: Channels) -> None:
    alone = fly(engine, np.arange(17, 17 + BATCH))
    assert same(block, 17, alone, 0) == []
    ids = 500 - 7 * np.arange(BATCH)  # other company, other order
    ids[41] = 17
    assert same(block, 17, fly(engine, ids), 41) == []
    assert same(block, 17, block, 18) != []


def test_another_block_size_changes_no_more_than_rounding(mission: ScenarioFile, block: Channels) -> None:
    alone = fly(BatchEngine(mission, 1, jax.devices()[:1]), [17])
    for name, values in alone.items():
        np.testing.assert_allclose(values[:, 0], block[name][:, 17], **OTHER_BLOCK_SIZE, err_msg=name)


def test_another_seed_is_another_campaign(engine: BatchEngine, block: Channels) -> None:
    other = next(iter(engine.simulate(engine.prepare(1, np.arange(BATCH)))))
    assert not np.any(np.all(other.channels["rho_H"][0] == block["rho_H"][0], axis=1))


def test_a_block_left_after_its_first_segment_leaves_nothing_behind(engine: BatchEngine, block: Channels) -> None:
    flying = engine.simulate(engine.prepare(0, np.arange(BATCH)))
    before = set(threading.enumerate())
    first = next(flying)
    flying.close()  # waits for the segment that the devices work on
    assert set(threading.enumerate()) <= before
    assert not same(first.channels, 5, {name: values[:200] for name, values in block.items()}, 5)
    assert not same(fly(engine, np.arange(BATCH)), 5, block, 5)


def test_a_device_goes_on_while_another_is_late_but_not_far_ahead_of_the_caller() -> None:
    counted, third, released = itertools.count(1), threading.Event(), threading.Event()
    calls: list[int] = []

    def quick() -> int:
        calls.append(next(counted))
        if len(calls) == device_programs.CALLS_AHEAD + 1:
            third.set()
        return calls[-1]

    def late() -> bool:
        return released.wait(30.0)

    results = device_programs.call_in_threads([quick, late], 10)
    begun = threading.Thread(target=next, args=(results,))
    begun.start()
    assert third.wait(30.0)  # though the other has not given its first result
    released.set()
    begun.join()
    results.close()
    assert len(calls) == device_programs.CALLS_AHEAD + 1
    assert list(device_programs.call_in_threads([lambda: next(counted)], 3)) == [[4], [5], [6]]


def test_an_error_in_a_device_s_thread_is_the_caller_s() -> None:
    def lost() -> float:
        raise ValueError("device lost")

    before = set(threading.enumerate())
    with pytest.raises(ValueError, match="device lost"):
        next(device_programs.call_in_threads([lambda: 1.0, lost], 4))
    assert set(threading.enumerate()) <= before


def test_a_campaign_of_many_blocks_traces_the_loop_once(
    mission: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    simulate_tick = step

    def counted(*arguments: Any) -> Any:
        calls.append(len(arguments))
        return simulate_tick(*arguments)

    monkeypatch.setattr(batch_engine, "step", counted)
    monkeypatch.delenv(trace_cache.FOLDER_VARIABLE, raising=False)
    anew = mission.model_copy(update={"name": "not compiled by another test"})
    result = run_campaign(anew, 3, tmp_path / "runs", block_size=1, devices=jax.devices()[:1])
    assert result.missing_blocks() == []
    assert len(calls) == 1


def test_missions_with_segments_as_long_share_their_traces(
    mission: ScenarioFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    simulate_tick, init = step, initial_state.init
    monkeypatch.setattr(batch_engine, "step", lambda *arguments: calls.append("step") or simulate_tick(*arguments))
    monkeypatch.setattr(initial_state, "init", lambda *arguments: calls.append("init") or init(*arguments))

    def traced(duration_s: float) -> BatchEngine:
        engine = BatchEngine(mission.model_copy(update={"duration_s": duration_s}), 1, jax.devices()[:1])
        assert engine._loop_trace.outputs is not None
        return engine

    assert traced(400.0).segment_ticks == 200
    calls.clear()
    assert traced(6000.0).segment_ticks == 200
    assert calls == []


def in_process_with_devices(count: int, *words: str, flags: str = "") -> str:
    """Standard output of a Python process that sees some host devices and compiles as this one does."""
    environment = {name: value for name, value in os.environ.items() if name not in ("XLA_FLAGS", "RPOJAX_CACHE")}
    own = [flag for flag in os.environ.get("XLA_FLAGS", "").split() if "fusion_emitters" in flag]
    environment["XLA_FLAGS"] = " ".join([f"--xla_force_host_platform_device_count={count}", flags, *own])
    environment["PYTHONPATH"] = str(Path(rpojax.__file__).parents[1])
    cache: str | None = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    environment |= {"JAX_COMPILATION_CACHE_DIR": cache} if cache else {"RPOJAX_CACHE": "off"}
    return subprocess.run([sys.executable, *words], env=environment, check=True, capture_output=True, text=True).stdout


EXCHANGE = """
import jax
import numpy as np
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.runtime import device_programs, trace_cache
from rpojax.scenario.loading import scenario_loader

engine = BatchEngine(scenario_loader.load("inspection", ["duration_s=200"]), 2)
orders = [3, 4, 17, 18], [17, 18, 3, 4]
there, back = (next(engine.simulate(engine.prepare(0, np.array(ids)))).channels for ids in orders)
equal = [there[name].tobytes() == np.roll(back[name], 2, axis=1).tobytes() for name in there]
print(len(engine.devices), len(equal), all(equal))
"""


def test_a_run_is_the_same_to_the_last_bit_on_either_device() -> None:
    flags = fast_compile_flags.FLAGS[0]
    devices, channels, equal = in_process_with_devices(2, "-c", EXCHANGE, flags=flags).split()
    assert (devices, equal) == ("2", "True")
    assert int(channels) > 20


@pytest.mark.slow
def test_two_devices_give_the_campaign_that_one_gives_to_the_last_bit(
    tmp_path: Path, arrays: Callable[[Path], dict[str, np.ndarray]]
) -> None:
    words = ["-m", "rpojax", "campaign", "inspection", "--set", "duration_s=400", "--runs", "72", "--block-size", "32"]
    for count in (1, 2):
        printed = in_process_with_devices(count, *words, "--no-report", "--json", "--out", str(tmp_path / f"{count}"))
        assert json.loads(printed)["provenance"]["timing"]["devices"] == count
    expected, found = arrays(tmp_path / "1"), arrays(tmp_path / "2")
    assert expected.keys() == found.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
