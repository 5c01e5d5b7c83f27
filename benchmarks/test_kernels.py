"""Speed of the closed loop's kernels on all devices: bare orbits, and the orbit filter by batch size."""

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from rpojax.campaign import filter_benchmark, orbit_benchmark
from rpojax.simulation import scenario


@pytest.mark.parametrize("vehicles", [256, orbit_benchmark.VEHICLES, 4096])
def test_orbits(benchmark: BenchmarkFixture, vehicles: int) -> None:
    program = orbit_benchmark.prepare(vehicles)
    benchmark.group = "orbits with J2, by vehicles on a device"
    benchmark.pedantic(program.run, warmup_rounds=1, rounds=6)
    assert benchmark.stats is not None
    total = vehicles * len(program.inputs) * orbit_benchmark.STEPS
    benchmark.extra_info |= {
        "vehicle_steps_per_s": total / benchmark.stats["min"],
        "compile_s": program.compile_s,
        "devices": len(program.inputs),
    }


@pytest.mark.parametrize("batch", [1, *filter_benchmark.BATCHES])
def test_filter(benchmark: BenchmarkFixture, batch: int) -> None:
    program = filter_benchmark.prepare(scenario.load("inspection"), batch)
    benchmark.group = "orbit filter, by runs on a device"
    benchmark.pedantic(program.run, warmup_rounds=1, rounds=6)
    assert benchmark.stats is not None
    updates = batch * len(program.inputs) * filter_benchmark.UPDATES
    benchmark.extra_info |= {
        "us_per_update": 1e6 * benchmark.stats["min"] / updates,
        "compile_s": program.compile_s,
        "devices": len(program.inputs),
    }
