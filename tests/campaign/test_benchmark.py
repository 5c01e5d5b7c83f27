"""The benchmark measures what it says, at a size where it takes no time."""

import jax
import pytest

from rpojax.campaign import benchmark
from rpojax.errors import RpojaxError
from rpojax.simulation.schema import ScenarioFile


def test_speed_is_simulated_time_of_all_runs_over_the_fastest_pass(
    mission: ScenarioFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    passes = iter([100.0, 3.0, 2.0, 4.0])  # the first one warms up
    monkeypatch.setattr(benchmark, "fly", lambda engine: next(passes))
    engine = benchmark.prepare(mission, 1)
    found = benchmark.speed(engine, 1)
    assert (found.batch, found.devices, found.run_s) == (1, 1, 2.0)
    assert found.run_seconds_per_s == mission.duration_s / 2.0


def test_the_headline_is_the_fastest_batch_and_says_where(mission: ScenarioFile) -> None:
    found = benchmark.measure(mission, [1])
    assert found["run_seconds_per_s"] == found["batches"][0]["run_seconds_per_s"] > 0.0
    assert (found["batch"], found["devices"], found["duration_s"]) == (1, 1, 400.0)
    assert found["backend"] == jax.default_backend()
    assert found["machine"]


def test_a_batch_is_shared_evenly_and_no_device_is_idle(mission: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmark.Engine, "compile", lambda engine, seed: None)
    devices = jax.devices()[:1]
    assert benchmark.prepare(mission, 5, devices).size == 5
    if len(jax.devices()) > 1:
        assert benchmark.prepare(mission, 5, jax.devices()[:2]).size == 3
    assert len(benchmark.prepare(mission, 1).devices) == 1


@pytest.mark.parametrize("batches", [(), (0,), (8, -1)])
def test_batches_that_make_no_sense_are_refused(mission: ScenarioFile, batches: tuple[int, ...]) -> None:
    with pytest.raises(RpojaxError, match="--runs"):
        benchmark.measure(mission, batches)
