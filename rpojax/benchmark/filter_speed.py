"""Speed of the orbit filter: predictions and updates with GPS and a box, for many runs at once."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.batching import vmap_last_axis
from rpojax.benchmark import timing
from rpojax.benchmark.timing import DeviceProgram
from rpojax.campaign import single_run
from rpojax.core import quaternion
from rpojax.core.numerics import safe
from rpojax.core.pytree import pytree
from rpojax.flight.computer import FlightParams
from rpojax.flight.guidance import target_pointing
from rpojax.flight.navigation import orbit_filter, outlier_gate
from rpojax.flight.navigation.filter_tuning import BoxMeasurement, GpsMeasurement, OrbitFilterTuning
from rpojax.flight.navigation.orbit_filter import OrbitEstimate
from rpojax.flight.navigation.outlier_gate import GateState
from rpojax.physics import plant
from rpojax.scenario.scenario_file import Scenario
from rpojax.scenario.schema import ScenarioFile

Scalar = Float[Array, ""]

DEFAULT_BATCHES = (64, 128, 256)
"""Runs per device that are measured; the best of them counts."""
DEFAULT_UPDATES = 200

NOISES_PER_UPDATE = 6
"""Standard normal numbers of a second: GPS, middle and size of the box."""
_HALF_FRAME = 0.1


@dataclass(frozen=True)
class FilterSpeed:
    """One batch size.

    Attributes:
        batch: runs at once, on all devices together
        devices: devices that share them
        updates: of each run in a pass
        compile_s: tracing and compiling [s]
        run_s: fastest pass [s]
        cpu_s: what it took of the processor [s]
        us_per_update: prediction and update of one run [us]
    """

    batch: int
    devices: int
    updates: int
    compile_s: float
    run_s: float
    cpu_s: float
    us_per_update: float


@pytree
class FilterInputs:
    """What the filter gets for one second.

    Attributes:
        delta_v_N: (3,) velocity change of a burn in it [m/s]
        burn_delta_v: () of the whole burn [m/s]
        doubt: () factor on the execution error
        pull_N: (3,) of the Sun and the Moon [m/s^2]
        q_KN: (4,) attitude of the camera
        gps: position
        box: bounding box
    """

    delta_v_N: Array
    burn_delta_v: Array
    covariance_inflation: Array
    third_body_acceleration_N: Array
    q_KN: Array
    gps: GpsMeasurement
    box: BoxMeasurement


def predict_and_update(
    scenario: Scenario,
    tuning: OrbitFilterTuning,
    focal_px: Scalar,
    estimate: OrbitEstimate,
    track: GateState,
    given: FilterInputs,
) -> tuple[OrbitEstimate, GateState]:
    """Estimate a second later, with the measurements of its end, and the gate's memory."""
    burn = (given.delta_v_N, given.burn_delta_v, given.covariance_inflation)
    degree, dt = scenario.navigation_zonal_degree, scenario.tick_s
    estimate = orbit_filter.predict(tuning, degree, estimate, *burn, given.third_body_acceleration_N, dt)
    estimate, track, _ = orbit_filter.update(
        tuning, scenario.box_gating, focal_px, estimate, track, given.gps, given.q_KN, given.box
    )
    return estimate, track


def nominal_setup(file: ScenarioFile) -> tuple[Scenario, FlightParams, OrbitEstimate]:
    """Static settings, flight software's numbers and the start of the nominal run, as an estimate without error."""
    # The table of kernels is of double precision, whatever the loop is in.
    scenario, params = single_run.nominal_parameters(file.model_copy(update={"precision": "double"}))
    identity = jnp.array([1.0, 0.0, 0.0, 0.0], dtype=jnp.float64)
    initial = params.initial
    true = plant.initial_truth(
        params.plant, params.orbit, initial.relative_position, initial.relative_velocity, identity
    )
    servicer = (true.r_TN_N + true.r_ST_N, true.v_TN_N + true.v_ST_N)
    return (
        scenario,
        params.flight,
        orbit_filter.initial(params.flight.navigation, *servicer, -true.r_ST_N, -true.v_ST_N),
    )


def propagate_truth(scenario: Scenario, flight: FlightParams, at: OrbitEstimate) -> OrbitEstimate:
    """The true orbits a second later, by the filter's own model of them."""
    zero, none = jnp.zeros((), dtype=jnp.float64), jnp.zeros(3, dtype=jnp.float64)
    degree, dt = scenario.navigation_zonal_degree, scenario.tick_s
    return orbit_filter.predict(flight.navigation, degree, at, none, zero, zero + 1.0, none, dt)


def synthetic_measurements(flight: FlightParams, at: OrbitEstimate, noise: Float[Array, "6"]) -> FilterInputs:
    """What is measured of true orbits by a camera that looks at the target, with standard normal numbers."""
    tuning, focal = flight.navigation, flight.vehicle.focal_px
    q_BN, _ = target_pointing.look_attitude(flight.vehicle, at)
    r_TS_N = at.relative.r_TS_N
    angle = tuning.target_size / safe.norm(r_TS_N)
    pixel = tuning.edge_noise / focal
    zero, none, yes = jnp.zeros_like(angle), jnp.zeros_like(r_TS_N), jnp.ones_like(angle, dtype=bool)
    return FilterInputs(
        delta_v_N=none,
        burn_delta_v=zero,
        covariance_inflation=zero + 1.0,
        third_body_acceleration_N=none,
        q_KN=quaternion.multiply(quaternion.normalize(flight.vehicle.camera_mounting), q_BN),
        gps=GpsMeasurement(position_N=at.servicer.r_SN_N + tuning.gps_noise * noise[:3], present=yes),
        box=BoxMeasurement(
            tangent=pixel * noise[3:5],
            log_size=jnp.log(angle) + pixel / angle * noise[5],
            side_px=angle * focal,
            present=yes,
            truncated=~yes,
            half_frame_tangent=jnp.full(2, _HALF_FRAME, dtype=jnp.float64),
            attitude_variance_change=zero,
        ),
    )


def simulate_measurements(
    scenario: Scenario, flight: FlightParams, start: OrbitEstimate, noise: Float[Array, "t 6 n"]
) -> tuple[OrbitEstimate, FilterInputs]:
    """The true orbits at the end, and all measurements on the way, time first and runs last."""
    every = _batched(synthetic_measurements, (None, None, -1))

    def second(at: OrbitEstimate, noise: Array) -> tuple[OrbitEstimate, FilterInputs]:
        after = propagate_truth(scenario, flight, at)
        return after, every(flight, after, noise)

    return jax.lax.scan(second, start, noise)


def run_filter(
    scenario: Scenario, flight: FlightParams, estimate: OrbitEstimate, track: GateState, given: FilterInputs
) -> OrbitEstimate:
    """Estimates of all runs after all measurements."""
    every = _batched(lambda *own: predict_and_update(scenario, *own), (None, None, -1, -1, -1))

    def second(
        carry: tuple[OrbitEstimate, GateState], given: FilterInputs
    ) -> tuple[tuple[OrbitEstimate, GateState], None]:
        return every(flight.navigation, flight.vehicle.focal_px, *carry, given), None

    return jax.lax.scan(second, (estimate, track), given)[0][0]


def _batched(function: Callable[..., Any], in_axes: tuple[int | None, ...]) -> Callable[..., Any]:
    """A function of one run as one of many, which lie along the last axes of its arguments and results."""
    return vmap_last_axis.vmap(function, in_axes, -1)


def broadcast(tree: Any, batch: int) -> Any:
    """The same for every run, runs last."""
    return jax.tree.map(lambda leaf: jnp.repeat(leaf[..., None], batch, axis=-1), tree)


def compile_filter(
    file: ScenarioFile, batch: int, updates: int = DEFAULT_UPDATES, devices: Sequence[Any] | None = None
) -> DeviceProgram:
    """Program that filters the measurements of `batch` runs on each device."""
    used = list(jax.devices() if devices is None else devices)
    scenario, flight, start = nominal_setup(file)
    noise = jnp.asarray(np.random.default_rng(0).standard_normal((updates, NOISES_PER_UPDATE, batch)))
    _, given = jax.jit(lambda noise: simulate_measurements(scenario, flight, start, noise))(noise)
    share = (flight, *broadcast((start, outlier_gate.initial()), batch), given)
    return timing.compile_for_devices(lambda *own: run_filter(scenario, *own), [share] * len(used), used)


def measure_batch(
    file: ScenarioFile, batch: int, updates: int = DEFAULT_UPDATES, devices: Sequence[Any] | None = None
) -> FilterSpeed:
    """Time of an update with `batch` runs on each device."""
    program = compile_filter(file, batch, updates, devices)
    taken = program.fastest_pass()
    total = batch * len(program.inputs)
    return FilterSpeed(
        batch=total,
        devices=len(program.inputs),
        updates=updates,
        compile_s=program.compile_s,
        run_s=taken.wall_s,
        cpu_s=taken.cpu_s,
        us_per_update=1e6 * taken.wall_s / (total * updates),
    )


def measure(file: ScenarioFile, batches: Sequence[int] = DEFAULT_BATCHES) -> dict[str, Any]:
    """Speeds of all batch sizes per device; the headline is that of the fastest one."""
    speeds = [measure_batch(file, batch) for batch in batches]
    best = min(speeds, key=lambda entry: entry.us_per_update)
    return {**asdict(best), "batches": [asdict(entry) for entry in speeds]}
