"""Speed of the closed loop, measured at sizes that take no time."""

import jax
import pytest

from rpojax.benchmark import closed_loop_speed
from rpojax.benchmark.closed_loop_speed import ClosedLoopSpeed
from rpojax.benchmark.timing import ElapsedTime
from rpojax.errors import RpojaxError
from rpojax.scenario.schema import ScenarioFile


def test_speed_is_simulated_time_of_all_runs_over_the_fastest_pass(
    mission: ScenarioFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    passes = iter([ElapsedTime(1.0, 1.0), ElapsedTime(3.0, 3.0), ElapsedTime(2.0, 3.5), ElapsedTime(4.0, 4.0)])
    monkeypatch.setattr(closed_loop_speed, "time_pass", lambda engine: next(passes))
    found = closed_loop_speed.measure_batch(closed_loop_speed.compile_engine(mission, 1), 1, 0.5, repeats=3)
    assert (found.batch, found.devices, found.run_s, found.cpu_s, found.compile_cached_s) == (1, 1, 2.0, 3.5, 0.5)
    assert found.run_seconds_per_s == mission.duration_s / 2.0
    assert found.runs_per_hour == 3600.0 * found.run_seconds_per_s / 3000.0


def test_headline_is_the_fastest_batch(mission: ScenarioFile, keep_compiled: None) -> None:
    found = closed_loop_speed.measure(mission, [1])
    assert found["run_seconds_per_s"] == found["batches"][0]["run_seconds_per_s"] > 0.0
    assert (found["batch"], found["devices"], found["duration_s"]) == (1, 1, 400.0)
    assert found["recommended_block_size"] is None  # the default block was not measured


def synthetic_speeds(**by_batch: float) -> list[ClosedLoopSpeed]:
    """Speeds in run-seconds per second on two devices, one for batch 1."""
    return [
        ClosedLoopSpeed(
            batch=int(name[1:]),
            devices=min(int(name[1:]), 2),
            compile_s=1.0,
            loop_compile_s=0.5,
            compile_cached_s=1.0,
            run_s=1.0,
            cpu_s=1.0,
            run_seconds_per_s=rate,
            runs_per_hour=rate,
        )
        for name, rate in by_batch.items()
    ]


@pytest.mark.parametrize(
    ("speeds", "size"),
    [
        ({"b1": 1.0, "b512": 100.0, "b2048": 112.0}, 1024),
        ({"b64": 112.0, "b512": 100.0}, 32),
        ({"b512": 100.0, "b2048": 110.0}, None),
        ({"b512": 100.0, "b2048": 50.0}, None),
        ({"b64": 1.0, "b2048": 50.0}, None),
    ],
)
def test_block_size_is_recommended_if_a_run_takes_a_tenth_less_time(speeds: dict[str, float], size: int | None) -> None:
    assert closed_loop_speed.recommended_block_size(synthetic_speeds(**speeds), 512) == size


def test_default_block_is_among_the_default_batches(mission: ScenarioFile) -> None:
    assert closed_loop_speed.default_batch(mission) in closed_loop_speed.default_batches(mission)


def test_large_batches_of_rendered_runs_are_not_measured_by_default(mission: ScenarioFile) -> None:
    rendered = mission.model_copy(update={"camera": mission.camera.model_copy(update={"model": "rendered"})})
    assert closed_loop_speed.default_batches(rendered) == (1, closed_loop_speed.default_batch(rendered))


def test_batch_is_divided_evenly_and_no_device_is_idle(mission: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(closed_loop_speed.BatchEngine, "compile", lambda engine: None)
    devices = jax.devices()[:1]
    assert closed_loop_speed.compile_engine(mission, 5, devices).runs_per_device == 5
    if len(jax.devices()) > 1:
        assert closed_loop_speed.compile_engine(mission, 5, jax.devices()[:2]).runs_per_device == 3
    assert len(closed_loop_speed.compile_engine(mission, 1).devices) == 1


@pytest.mark.parametrize("batches", [(), (0,), (8, -1)])
def test_invalid_batches_are_refused(mission: ScenarioFile, batches: tuple[int, ...]) -> None:
    with pytest.raises(RpojaxError, match=r"^runs:"):
        closed_loop_speed.measure(mission, batches)
