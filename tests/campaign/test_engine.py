"""One trace for a campaign, and numbers of a run that depend on nothing but scenario, seed and run number."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

import rpojax
from rpojax.campaign.engine import Engine
from rpojax.campaign.runner import run_campaign
from rpojax.campaign.store import Campaign
from rpojax.simulation import closed_loop
from rpojax.simulation.schema import ScenarioFile

BATCH = 64
MOST_MULTIPLICATIONS = 4500
"""A quarter above what the compiled loop needs; recomputing across stage borders once took four times as many."""
OTHER_BLOCK_SIZE = {"rtol": 1e-5, "atol": 1e-5}
"""Programs for different block sizes round differently; in 400 s that stays far below what single precision shows."""

Channels = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def engine(mission: ScenarioFile) -> Engine:
    """One device that takes `BATCH` runs."""
    engine = Engine(mission, BATCH, jax.devices()[:1])
    engine.compile(seed=0)
    return engine


def fly(engine: Engine, ids: Sequence[int] | np.ndarray) -> Channels:
    """All channels (ticks, runs, ...) of the given runs."""
    segments = list(engine.run(engine.prepare(0, np.asarray(ids))))
    assert [segment.first_tick for segment in segments] == [0, 200]
    return {name: np.concatenate([segment.channels[name] for segment in segments]) for name in segments[0].channels}


@pytest.fixture(scope="module")
def block(engine: Engine) -> Channels:
    """Runs 0 to 63, in order."""
    return fly(engine, np.arange(BATCH))


def same(first: Channels, column: int, second: Channels, other: int) -> list[str]:
    """Channels in which two runs differ in any bit."""
    return [
        name
        for name in first
        if not np.array_equal(first[name][:, column], second[name][:, other], equal_nan=first[name].dtype.kind == "f")
    ]


def test_a_run_is_the_same_to_the_last_bit_alone_and_anywhere_in_a_block(engine: Engine, block: Channels) -> None:
    alone = fly(engine, np.arange(17, 17 + BATCH))
    assert same(block, 17, alone, 0) == []
    ids = 500 - 7 * np.arange(BATCH)  # other company, other order
    ids[41] = 17
    assert same(block, 17, fly(engine, ids), 41) == []
    assert same(block, 17, block, 18) != []


def test_another_block_size_changes_no_more_than_rounding(mission: ScenarioFile, block: Channels) -> None:
    alone = fly(Engine(mission, 1, jax.devices()[:1]), [17])
    for name, values in alone.items():
        np.testing.assert_allclose(values[:, 0], block[name][:, 17], **OTHER_BLOCK_SIZE, err_msg=name)


def test_another_seed_is_another_campaign(engine: Engine, block: Channels) -> None:
    other = next(iter(engine.run(engine.prepare(1, np.arange(BATCH)))))
    assert not np.any(np.all(other.channels["rho_H"][0] == block["rho_H"][0], axis=1))


def test_a_campaign_of_many_blocks_traces_the_loop_once(
    mission: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    tick = closed_loop.tick

    def counted(*arguments: Any) -> Any:
        calls.append(len(arguments))
        return tick(*arguments)

    monkeypatch.setattr(closed_loop, "tick", counted)
    anew = mission.model_copy(update={"name": "not compiled by another test"})
    result = run_campaign(anew, 3, tmp_path / "runs", block_size=1, devices=jax.devices()[:1])
    assert result.missing() == []
    assert len(calls) == 1


def test_the_compiled_loop_does_not_recompute(engine: Engine) -> None:
    assert engine._programs is not None
    assert engine._programs[1][0].as_text().count(" multiply(") < MOST_MULTIPLICATIONS


def in_process_with_two_devices(*words: str, flags: str = "") -> str:
    """Standard output of a Python process that sees two host devices."""
    environment = {name: value for name, value in os.environ.items() if name not in ("XLA_FLAGS", "RPOJAX_CACHE")}
    environment["XLA_FLAGS"] = f"--xla_force_host_platform_device_count=2 {flags}"
    environment["PYTHONPATH"] = str(Path(rpojax.__file__).parents[1])
    cache: str | None = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    environment |= {"JAX_COMPILATION_CACHE_DIR": cache} if cache else {"RPOJAX_CACHE": "off"}
    return subprocess.run([sys.executable, *words], env=environment, check=True, capture_output=True, text=True).stdout


COMPARISON = """
import jax
import numpy as np
from rpojax.campaign.engine import Engine
from rpojax.simulation import scenario

def fly(devices, ids):
    engine = Engine(scenario.load("inspection", ["duration_s=200"]), 1, devices)
    return next(engine.run(engine.prepare(0, np.array(ids)))).channels

both, second = fly(jax.devices(), [0, 5]), fly(jax.devices()[:1], [5])
equal = [np.array_equal(both[name][:, 1], second[name][:, 0]) for name in both]
print(len(jax.devices()), len(equal), all(equal))
"""


def test_a_run_on_the_second_device_is_what_it_is_on_the_only_one() -> None:
    # Without optimisation two programs compile in the time of one; the slow test below has it on.
    printed = in_process_with_two_devices("-c", COMPARISON, flags="--xla_backend_optimization_level=0")
    devices, channels, equal = printed.split()
    assert (devices, equal) == ("2", "True")
    assert int(channels) > 20


@pytest.mark.slow
def test_two_devices_give_the_campaign_that_one_gives_bit_for_bit(
    three_runs: Campaign, tmp_path: Path, arrays: Callable[[Path], dict[str, np.ndarray]]
) -> None:
    out = tmp_path / "two"
    words = ["--set", "duration_s=400", "--runs", "3", "--block-size", "1", "--histories", "0,2", "--no-report"]
    command = ["-m", "rpojax", "campaign", "inspection", *words, "--json", "--out", str(out)]
    timing = json.loads(in_process_with_two_devices(*command))["provenance"]["timing"]
    assert (timing["devices"], three_runs.info["timing"]["devices"]) == (2, 1)
    expected, found = arrays(three_runs.directory), arrays(out)
    assert expected.keys() == found.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
