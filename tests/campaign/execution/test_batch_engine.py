"""Results of a run depend only on scenario, seed and run number, and numbers compile nothing anew."""

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

import rpojax
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.runtime.programs_per_device import DeviceTraces
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

BATCH = 20
ROUNDING = {"rtol": 1e-5, "atol": 1e-5}
"""Programs for other block sizes round differently; over 400 s the differences stay below single precision."""

Channels = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def engine(mission: ScenarioFile) -> BatchEngine:
    """Engine of one device and `BATCH` runs."""
    engine = BatchEngine(mission, BATCH, jax.devices()[:1])
    engine.compile()
    return engine


def simulate(engine: BatchEngine, ids: Sequence[int] | np.ndarray) -> Channels:
    """Channels (ticks, runs, ...) of some runs."""
    segments = list(engine.simulate(engine.prepare(0, np.asarray(ids))))
    assert [segment.first_tick for segment in segments] == [0, 200]
    return {name: np.concatenate([segment.channels[name] for segment in segments]) for name in segments[0].channels}


@pytest.fixture(scope="module")
def channels(engine: BatchEngine) -> Channels:
    """The first runs, in order."""
    return simulate(engine, np.arange(BATCH))


def different_channels(first: Channels, column: int, second: Channels, other: int) -> list[str]:
    """Channels in which two runs differ in any bit."""
    return [
        name
        for name in first
        if not np.array_equal(first[name][:, column], second[name][:, other], equal_nan=first[name].dtype.kind == "f")
    ]


def test_run_is_equal_to_the_last_bit_at_any_place_of_any_batch(engine: BatchEngine, channels: Channels) -> None:
    first = simulate(engine, np.arange(17, 17 + BATCH))
    assert different_channels(channels, 17, first, 0) == []
    ids = 500 - 7 * np.arange(BATCH)  # other runs, other order
    ids[11] = 17
    assert different_channels(channels, 17, simulate(engine, ids), 11) == []
    assert different_channels(channels, 17, channels, 18) != []


def test_other_block_size_changes_only_rounding(mission: ScenarioFile, channels: Channels) -> None:
    alone = simulate(BatchEngine(mission, 1, jax.devices()[:1]), [17])
    for name, values in alone.items():
        np.testing.assert_allclose(values[:, 0], channels[name][:, 17], **ROUNDING, err_msg=name)


def test_other_seed_gives_other_runs(engine: BatchEngine, channels: Channels) -> None:
    other = next(iter(engine.simulate(engine.prepare(1, np.arange(BATCH)))))
    assert not np.any(np.all(other.channels["rho_H"][0] == channels["rho_H"][0], axis=1))


def test_closing_an_unfinished_batch_ends_its_threads(engine: BatchEngine, channels: Channels) -> None:
    segments = engine.simulate(engine.prepare(0, np.arange(BATCH)))
    before = set(threading.enumerate())
    first = next(segments)
    segments.close()  # waits for the segment that the devices work on
    assert set(threading.enumerate()) <= before
    assert not different_channels(first.channels, 5, {name: values[:200] for name, values in channels.items()}, 5)
    assert not different_channels(simulate(engine, np.arange(BATCH)), 5, channels, 5)


OTHER_NUMBERS = [
    "duration_s=37",
    "epoch_utc=2031-05-01T03:00:00",
    "safety.stuck_on_s=20",
    "safety.horizons=['3_orbits', '10_h', '24_h']",
    "servicer.mass_kg=31",
    "orbit.raan_deg=78",
    "navigation.gate_sigma=4",
    "limits.keep_out_m=8",
    "dispersions.initial.relative_position_m.sigma=3",
]


def test_missions_that_differ_in_numbers_share_compiled_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(DeviceTraces, "compile", lambda traces, options: traces)

    def programs(changes: Sequence[str]) -> dict[str, str]:
        engine = BatchEngine(scenario_loader.load("inspection", changes), 1, jax.devices()[:1])
        engine.passive_safety.compile(engine._preparation_trace.out_info[0])
        traces: Any = {
            "preparation": engine._preparation_trace,
            "loop": engine._loop_traces.traces[engine.devices[0]],
            "drifts": engine.passive_safety._programs.traces[engine.devices[0]],  # type: ignore[union-attr]
        }
        return {name: trace.lower().as_text() for name, trace in traces.items()}

    first, second = programs(["duration_s=400"]), programs(OTHER_NUMBERS)
    assert [name for name in first if first[name] != second[name]] == []


def in_process_with_devices(count: int, *words: str) -> str:
    """Standard output of a Python process with `count` host devices and the compiler flags of this one."""
    environment = {name: value for name, value in os.environ.items() if name not in ("XLA_FLAGS", "RPOJAX_CACHE")}
    own = [flag for flag in os.environ.get("XLA_FLAGS", "").split() if "fusion_emitters" in flag]
    environment["XLA_FLAGS"] = " ".join([f"--xla_force_host_platform_device_count={count}", *own])
    environment["PYTHONPATH"] = str(Path(rpojax.__file__).parents[1])
    cache: str | None = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    environment |= {"JAX_COMPILATION_CACHE_DIR": cache} if cache else {"RPOJAX_CACHE": "off"}
    return subprocess.run([sys.executable, *words], env=environment, check=True, capture_output=True, text=True).stdout


@pytest.mark.slow
def test_campaign_is_equal_to_the_last_bit_on_one_and_two_devices(
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
