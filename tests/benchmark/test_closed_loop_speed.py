"""The benchmarks measure what they say, at sizes where they take no time."""

from dataclasses import asdict, fields
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.benchmark import closed_loop_speed, compile_time, filter_speed, orbit_speed, suite, timing, vision_speed
from rpojax.benchmark.closed_loop_speed import ClosedLoopSpeed
from rpojax.benchmark.timing import ElapsedTime
from rpojax.core.constants import MU_EARTH
from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.orbits import orbital_mechanics
from rpojax.errors import RpojaxError
from rpojax.flight.navigation import outlier_gate
from rpojax.scenario.schema import ScenarioFile


def test_the_fastest_pass_counts_but_not_the_first() -> None:
    passes = iter([ElapsedTime(1.0, 1.0), ElapsedTime(3.0, 5.0), ElapsedTime(2.0, 4.0), ElapsedTime(4.0, 3.0)])
    assert timing.fastest_pass(lambda: next(passes), 3) == ElapsedTime(2.0, 4.0)
    assert next(passes, None) is None


def test_a_program_gives_every_device_its_share() -> None:
    devices = jax.devices()
    shares = [(np.float64(number),) for number in range(len(devices))]
    program = timing.compile_for_devices(lambda x: 2.0 * x, shares, devices)
    assert [float(result) for result in program.run()] == [2.0 * number for number in range(len(devices))]
    assert program.compile_s > 0.0


def test_speed_is_simulated_time_of_all_runs_over_the_fastest_pass(
    mission: ScenarioFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    passes = iter([ElapsedTime(1.0, 1.0), ElapsedTime(3.0, 3.0), ElapsedTime(2.0, 3.5), ElapsedTime(4.0, 4.0)])
    monkeypatch.setattr(closed_loop_speed, "time_pass", lambda engine: next(passes))
    found = closed_loop_speed.measure_batch(closed_loop_speed.compile_engine(mission, 1), 1, 0.5, repeats=3)
    assert (found.batch, found.devices, found.run_s, found.cpu_s, found.compile_cached_s) == (1, 1, 2.0, 3.5, 0.5)
    assert found.run_seconds_per_s == mission.duration_s / 2.0
    assert found.runs_per_hour == 3600.0 * found.run_seconds_per_s / 3000.0


@pytest.fixture
def remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other tests keep what they have compiled."""
    monkeypatch.setattr(jax, "clear_caches", lambda: None)


def test_the_headline_is_the_fastest_batch(mission: ScenarioFile, remembered: None) -> None:
    found = closed_loop_speed.measure(mission, [1])
    assert found["run_seconds_per_s"] == found["batches"][0]["run_seconds_per_s"] > 0.0
    assert (found["batch"], found["devices"], found["duration_s"]) == (1, 1, 400.0)
    assert found["recommended_block_size"] is None  # the default block was not measured
    where = suite.platform_info()
    assert where["backend"] == jax.default_backend()
    assert where["machine"]
    assert where["peak_memory_mib"] > 100.0


def speeds(**by_batch: float) -> list[ClosedLoopSpeed]:
    """Speeds with the given run-seconds per second on two devices, one for batch 1."""
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
    ("measured", "size"),
    [
        ({"b1": 1.0, "b512": 100.0, "b2048": 112.0}, 1024),
        ({"b64": 112.0, "b512": 100.0}, 32),
        ({"b512": 100.0, "b2048": 110.0}, None),
        ({"b512": 100.0, "b2048": 50.0}, None),
        ({"b64": 1.0, "b2048": 50.0}, None),
    ],
)
def test_a_block_size_is_recommended_where_a_run_takes_a_tenth_less_of_its_time(
    measured: dict[str, float], size: int | None
) -> None:
    assert closed_loop_speed.recommended_block_size(speeds(**measured), 512) == size


def test_the_default_block_is_among_the_batches_that_are_measured(mission: ScenarioFile) -> None:
    assert closed_loop_speed.default_batch(mission) in closed_loop_speed.default_batches(mission)


def test_large_batches_of_pictures_are_not_measured_by_default(mission: ScenarioFile) -> None:
    rendered = mission.model_copy(update={"camera": mission.camera.model_copy(update={"model": "rendered"})})
    assert closed_loop_speed.default_batches(rendered) == (1, closed_loop_speed.default_batch(rendered))


def test_a_batch_is_shared_evenly_and_no_device_is_idle(mission: ScenarioFile, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(closed_loop_speed.BatchEngine, "compile", lambda engine: None)
    devices = jax.devices()[:1]
    assert closed_loop_speed.compile_engine(mission, 5, devices).runs_per_device == 5
    if len(jax.devices()) > 1:
        assert closed_loop_speed.compile_engine(mission, 5, jax.devices()[:2]).runs_per_device == 3
    assert len(closed_loop_speed.compile_engine(mission, 1).devices) == 1


@pytest.mark.parametrize("batches", [(), (0,), (8, -1)])
def test_batches_that_make_no_sense_are_refused(mission: ScenarioFile, batches: tuple[int, ...]) -> None:
    with pytest.raises(RpojaxError, match="--runs"):
        closed_loop_speed.measure(mission, batches)


def test_the_cache_of_a_benchmark_is_its_own_and_is_thrown_away(remembered: None) -> None:
    before: str | None = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    seen = []
    with pytest.raises(ZeroDivisionError), compile_time.temporary_cache() as folder:
        jax.jit(lambda x: jnp.sin(x) + 1.25).lower(1.0).compile()
        seen = list(folder.iterdir())
        raise ZeroDivisionError
    assert seen
    assert not folder.exists()
    assert before == jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]


def test_the_pull_on_many_vehicles_is_that_on_each() -> None:
    r_N, _ = orbit_speed.initial_orbits(7)
    found = np.asarray(orbit_speed.j2_gravity(jnp.asarray(r_N)))
    for vehicle in range(7):
        at = Difference(value=jnp.asarray(r_N[:, vehicle]), change=jnp.zeros(3))
        field = orbital_mechanics.EARTH_GRAVITY
        np.testing.assert_allclose(found[:, vehicle], orbital_mechanics.gravity(field, 2, at).value, rtol=1e-13)


def test_a_step_keeps_energy_and_momentum_about_the_pole() -> None:
    r_N, v_N = map(jnp.asarray, orbit_speed.initial_orbits(5))

    def kept(r_N: jax.Array, v_N: jax.Array) -> tuple[np.ndarray, np.ndarray]:
        radius = np.linalg.norm(r_N, axis=0)
        sine2 = np.asarray(r_N[2] / radius) ** 2
        j2 = orbital_mechanics.EARTH_GRAVITY.zonals[0] * (orbital_mechanics.EARTH_GRAVITY.radius / radius) ** 2
        potential = -MU_EARTH / radius * (1.0 - j2 * (1.5 * sine2 - 0.5))
        return 0.5 * np.sum(np.asarray(v_N) ** 2, axis=0) + potential, np.asarray(r_N[0] * v_N[1] - r_N[1] * v_N[0])

    before = kept(r_N, v_N)
    for _ in range(20):
        r_N, v_N = orbit_speed.rk4_step(r_N, v_N, orbit_speed.STEP_S)
    for old, new in zip(before, kept(r_N, v_N), strict=True):
        np.testing.assert_allclose(new, old, rtol=1e-13)


def test_orbits_are_counted_over_all_devices() -> None:
    found = orbit_speed.measure(vehicles=4, steps=3)
    assert found.vehicles == 4 * len(jax.devices())
    assert found.vehicle_steps_per_s == pytest.approx(found.vehicles * 3 / found.run_s)


def test_the_filter_is_measured_in_double_precision_whatever_the_loop_is_in(inspection_file: ScenarioFile) -> None:
    scenario, _, start = filter_speed.nominal_setup(inspection_file.model_copy(update={"precision": "single"}))
    assert scenario == filter_speed.nominal_setup(inspection_file)[0]
    assert start.servicer.orbit_low is None


def test_the_filter_that_is_measured_follows_the_truth(inspection_file: ScenarioFile) -> None:
    scenario, flight, start = filter_speed.nominal_setup(inspection_file)
    noise = jnp.asarray(np.random.default_rng(1).standard_normal((30, filter_speed.NOISES_PER_UPDATE, 3)))
    end, given = filter_speed.simulate_measurements(scenario, flight, start, noise)
    estimate, track = filter_speed.broadcast((start, outlier_gate.initial()), 3)
    found = filter_speed.run_filter(scenario, flight, estimate, track, given)
    error = np.asarray(found.relative.r_TS_N - end.relative.r_TS_N[:, None])
    claimed = np.sqrt(np.asarray(found.relative.covariance)[range(3), range(3)])
    assert np.all(np.abs(error) < 4.0 * claimed)
    # Boxes and fixes have been used: both are much surer than at the start.
    assert np.all(claimed[1:].min(axis=0) < 0.5 * np.sqrt(np.asarray(start.relative.covariance)[0, 0]))
    assert np.all(np.asarray(found.servicer.covariance)[0, 0] < 0.5 * np.asarray(start.servicer.covariance)[0, 0])


@pytest.mark.slow
def test_the_filter_is_measured_on_all_devices(inspection_file: ScenarioFile) -> None:
    found = filter_speed.measure_batch(inspection_file, 2, updates=3)
    assert found.batch == 2 * len(jax.devices())
    assert found.us_per_update == pytest.approx(1e6 * found.run_s / (3 * found.batch))


@pytest.mark.slow
def test_pictures_and_detections_are_counted_over_all_devices() -> None:
    found = vision_speed.measure(size=2)
    assert (found.batch, found.side_px) == (2 * len(jax.devices()), 128)
    assert found.frames_per_s == pytest.approx(found.batch / found.render_s)
    assert found.detections_per_s == pytest.approx(found.batch / found.detect_s)
    assert all(value > 0.0 for value in asdict(found).values())


@pytest.mark.parametrize(
    "record", [ClosedLoopSpeed, orbit_speed.OrbitSpeed, filter_speed.FilterSpeed, vision_speed.VisionSpeed]
)
def test_the_page_on_performance_explains_every_key(record: type) -> None:
    page = (Path(__file__).parents[2] / "docs" / "performance.md").read_text(encoding="utf-8")
    assert {field.name for field in fields(record) if f"`{field.name}`" not in page} == set()
