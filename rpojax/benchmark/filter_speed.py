"""Speed of the orbit filter: prediction over a second and update with GPS and a box, for many runs at once."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.benchmark.synthetic_filter_inputs import (
    NOISES_PER_UPDATE,
    FilterInputs,
    batch_last_axis,
    nominal_setup,
    simulate_measurements,
)
from rpojax.benchmark.timed_device_programs import MultiDeviceProgram, compile_for_devices
from rpojax.flight import stage_use
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import combined_orbit_filter, lasting_error_effects
from rpojax.flight.navigation.box_measurement import outlier_gate
from rpojax.flight.navigation.box_measurement.outlier_gate import GateState
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.runtime.programs_per_device import choose_devices
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario

Scalar = Float[Array, ""]

DEFAULT_BATCHES = (64, 128, 256)
"""Runs per device that are measured; the best of them counts."""
DEFAULT_UPDATES = 200


@dataclass(frozen=True)
class FilterSpeed:
    """Speed of one batch size.

    Attributes:
        batch: runs at once, on all devices together
        devices: devices that share them
        updates: of each run in a pass
        compile_s: tracing and compiling [s]
        run_s: fastest pass [s]
        cpu_s: processor time of that pass [s]
        us_per_update: prediction and update of one run [us]
    """

    batch: int
    devices: int
    updates: int
    compile_s: float
    run_s: float
    cpu_s: float
    us_per_update: float


def predict_and_update(
    scenario: Scenario,
    tuning: OrbitFilterTuning,
    focal_px: Scalar,
    estimate: OrbitEstimate,
    gate: GateState,
    inputs: FilterInputs,
) -> tuple[OrbitEstimate, GateState]:
    """Estimate a second later, updated with the measurements at its end, and the state of the outlier gate."""
    burn = (inputs.delta_v_N, inputs.burn_delta_v, inputs.covariance_inflation)
    degree, dt = scenario.navigation_zonal_degree, scenario.tick_s
    motion = (*burn, inputs.third_body_acceleration_N, lasting_error_effects.none())
    estimate = combined_orbit_filter.predict(tuning, degree, estimate, *motion, dt)
    estimate, gate, _ = combined_orbit_filter.update(
        tuning, scenario.box_gating, focal_px, estimate, gate, inputs.gps, inputs.q_KN, inputs.box
    )
    return estimate, gate


def run_filter(
    scenario: Scenario, flight: FlightParams, estimate: OrbitEstimate, gate: GateState, inputs: FilterInputs
) -> OrbitEstimate:
    """Estimates of all runs after all measurements."""
    batched_step = batch_last_axis(lambda *own: predict_and_update(scenario, *own), (None, None, -1, -1, -1))

    def second(
        carry: tuple[OrbitEstimate, GateState], inputs: FilterInputs
    ) -> tuple[tuple[OrbitEstimate, GateState], None]:
        return batched_step(flight.navigation, flight.vehicle.focal_px, *carry, inputs), None

    return jax.lax.scan(second, (estimate, gate), inputs)[0][0]


def broadcast(tree: Any, batch: int) -> Any:
    """Every leaf repeated for all runs, runs last."""
    return jax.tree.map(lambda leaf: jnp.repeat(leaf[..., None], batch, axis=-1), tree)


def compile_filter(
    file: ScenarioFile, batch: int, updates: int = DEFAULT_UPDATES, devices: Sequence[Any] | None = None
) -> MultiDeviceProgram:
    """Program that filters the measurements of `batch` runs on each device."""
    used = choose_devices(devices)
    scenario, flight, start = nominal_setup(file)
    noise = jnp.asarray(np.random.default_rng(0).standard_normal((updates, NOISES_PER_UPDATE, batch)))
    _, inputs = jax.jit(lambda noise: simulate_measurements(scenario, flight, start, noise))(noise)
    arguments = (flight, *broadcast((start, outlier_gate.initial()), batch), inputs)
    return compile_for_devices(lambda *own: run_filter(scenario, *own), [arguments] * len(used), used)


def measure_batch(
    file: ScenarioFile, batch: int, updates: int = DEFAULT_UPDATES, devices: Sequence[Any] | None = None
) -> FilterSpeed:
    """Speed of the filter with `batch` runs on each device."""
    program = compile_filter(file, batch, updates, devices)
    elapsed = program.fastest_pass()
    total = batch * len(program.inputs)
    return FilterSpeed(
        batch=total,
        devices=len(program.inputs),
        updates=updates,
        compile_s=program.compile_s,
        run_s=elapsed.wall_s,
        cpu_s=elapsed.cpu_s,
        us_per_update=1e6 * elapsed.wall_s / (total * updates),
    )


def check_filter(file: ScenarioFile) -> None:
    """Refuses a scenario whose plugin replaces the orbit filter, since the packaged one is measured.

    Raises:
        RpojaxError: naming the stage.
    """
    stage_use.check(plugin_registry.stages_of(file), (stage_use.BENCH_KERNELS,))


def measure(file: ScenarioFile, batches: Sequence[int] = DEFAULT_BATCHES) -> dict[str, Any]:
    """Speeds of all batch sizes per device as JSON, with those of the fastest one at the top.

    Raises:
        RpojaxError: the scenario replaces the orbit filter.
    """
    check_filter(file)
    speeds = [measure_batch(file, batch) for batch in batches]
    best = min(speeds, key=lambda entry: entry.us_per_update)
    return {**asdict(best), "batches": [asdict(entry) for entry in speeds]}
