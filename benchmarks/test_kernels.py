"""Speed of kernels of the closed loop on all devices: orbit propagation, and the orbit filter by batch size."""

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from rpojax.benchmark import filter_speed, orbit_speed
from rpojax.scenario.loading import scenario_loader


@pytest.mark.parametrize("vehicles", [256, orbit_speed.DEFAULT_VEHICLES, 4096])
def test_orbits(benchmark: BenchmarkFixture, vehicles: int) -> None:
    program = orbit_speed.compile_propagation(vehicles)
    benchmark.group = "orbit propagation with J2, by vehicles on a device"
    benchmark.pedantic(program.run, warmup_rounds=1, rounds=6)
    assert benchmark.stats is not None
    total = vehicles * len(program.inputs) * orbit_speed.DEFAULT_STEPS
    benchmark.extra_info |= {
        "vehicle_steps_per_s": total / benchmark.stats["min"],
        "compile_s": program.compile_s,
        "devices": len(program.inputs),
    }


@pytest.mark.parametrize("batch", [1, *filter_speed.DEFAULT_BATCHES])
def test_filter(benchmark: BenchmarkFixture, batch: int) -> None:
    program = filter_speed.compile_filter(scenario_loader.load("inspection"), batch)
    benchmark.group = "orbit filter, by runs on a device"
    benchmark.pedantic(program.run, warmup_rounds=1, rounds=6)
    assert benchmark.stats is not None
    updates = batch * len(program.inputs) * filter_speed.DEFAULT_UPDATES
    benchmark.extra_info |= {
        "us_per_update": 1e6 * benchmark.stats["min"] / updates,
        "compile_s": program.compile_s,
        "devices": len(program.inputs),
    }
