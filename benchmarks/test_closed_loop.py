"""Speed of the closed loop by batch size, and its compilation time."""

from functools import cache

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from rpojax.benchmark import closed_loop_speed
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

BATCHES = (1, 16, 64, 256, 512, 2048)


@cache
def mission() -> ScenarioFile:
    """The nominal mission, shortened."""
    return scenario_loader.load("inspection", ["duration_s=200"])


@cache
def engine(batch: int) -> BatchEngine:
    """Compiled engine for a batch."""
    return closed_loop_speed.compile_engine(mission(), batch)


@pytest.mark.parametrize("batch", BATCHES)
def test_closed_loop(benchmark: BenchmarkFixture, batch: int) -> None:
    compiled = engine(batch)
    benchmark.group = "closed loop"
    benchmark.pedantic(
        closed_loop_speed.simulate_runs,
        setup=lambda: ((compiled, closed_loop_speed.prepare_runs(compiled)), {}),
        rounds=6,
    )
    assert benchmark.stats is not None
    benchmark.extra_info |= {
        "run_seconds_per_s": batch * mission().duration_s / benchmark.stats["min"],
        "compile_s": compiled.compile_s,
        "devices": len(compiled.devices),
    }


def test_preparation(benchmark: BenchmarkFixture) -> None:
    compiled = engine(512)
    benchmark.group = "dispersions and initial states of 512 runs"
    benchmark.pedantic(closed_loop_speed.prepare_runs, args=(compiled,), warmup_rounds=1, rounds=5)


@pytest.mark.parametrize("batch", [1, 512])
def test_compilation(benchmark: BenchmarkFixture, batch: int) -> None:
    benchmark.group = "tracing and compiling"
    benchmark.pedantic(closed_loop_speed.compile_engine, args=(mission(), batch), rounds=1)
