"""Speed of the closed loop by batch size, and the time to compile it."""

from functools import cache

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from rpojax.benchmark import closed_loop_speed as closed_loop
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.scenario import scenario_file
from rpojax.scenario.schema import ScenarioFile

BATCHES = (1, 16, 64, 256, 512, 2048)


@cache
def mission() -> ScenarioFile:
    """The nominal mission, cut short."""
    return scenario_file.load("inspection", ["duration_s=200"])


@cache
def engine(batch: int) -> BatchEngine:
    """Compiled engine for a batch."""
    return closed_loop.compile_engine(mission(), batch)


@pytest.mark.parametrize("batch", BATCHES)
def test_closed_loop(benchmark: BenchmarkFixture, batch: int) -> None:
    ready = engine(batch)
    benchmark.group = "closed loop"
    benchmark.pedantic(
        closed_loop.simulate_runs, setup=lambda: ((ready, closed_loop.prepare_runs(ready)), {}), rounds=6
    )
    assert benchmark.stats is not None
    benchmark.extra_info |= {
        "run_seconds_per_s": batch * mission().duration_s / benchmark.stats["min"],
        "compile_s": ready.compile_s,
        "devices": len(ready.devices),
    }


def test_preparation(benchmark: BenchmarkFixture) -> None:
    ready = engine(512)
    benchmark.group = "dispersions and initial states of 512 runs"
    benchmark.pedantic(closed_loop.prepare_runs, args=(ready,), warmup_rounds=1, rounds=5)


@pytest.mark.parametrize("batch", [1, 512])
def test_compilation(benchmark: BenchmarkFixture, batch: int) -> None:
    benchmark.group = "tracing and compiling"
    benchmark.pedantic(closed_loop.compile_engine, args=(mission(), batch), rounds=1)
