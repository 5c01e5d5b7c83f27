"""Speed of the orbit filter: predictions and updates with GPS and a box, for many runs at once."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from rpojax.batching import vmap_last_axis
from rpojax.benchmark import stopwatch
from rpojax.benchmark.stopwatch import Program
from rpojax.campaign import single_run
from rpojax.core import quaternion
from rpojax.core.numerics import safe
from rpojax.core.pytree import pytree
from rpojax.flight.computer import FlightParams
from rpojax.flight.guidance import target_pointing
from rpojax.flight.navigation import orbit_filter, outlier_gate
from rpojax.flight.navigation.filter_tuning import BoxMeasurement, GpsMeasurement, Navigation
from rpojax.flight.navigation.orbit_filter import OrbitEstimate
from rpojax.flight.navigation.outlier_gate import BoxTrack
from rpojax.physics import plant
from rpojax.scenario.scenario_file import Scenario
from rpojax.scenario.schema import ScenarioFile

Scalar = Float[Array, ""]

BATCHES = (64, 128, 256)
"""Runs per device that are measured; the best of them counts."""
UPDATES = 200

NOISES = 6
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
class Given:
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
    doubt: Array
    pull_N: Array
    q_KN: Array
    gps: GpsMeasurement
    box: BoxMeasurement


def filtered(
    scenario: Scenario,
    tuning: Navigation,
    focal_px: Scalar,
    estimate: OrbitEstimate,
    track: BoxTrack,
    given: Given,
) -> tuple[OrbitEstimate, BoxTrack]:
    """Estimate a second later, with the measurements of its end, and the gate's memory."""
    burn = (given.delta_v_N, given.burn_delta_v, given.doubt)
    degree, dt = scenario.navigation_zonal_degree, scenario.tick_s
    estimate = orbit_filter.predict(tuning, degree, estimate, *burn, given.pull_N, dt)
    estimate, track, _ = orbit_filter.update(
        tuning, scenario.gated, focal_px, estimate, track, given.gps, given.q_KN, given.box
    )
    return estimate, track


def truth(file: ScenarioFile) -> tuple[Scenario, FlightParams, OrbitEstimate]:
    """Static settings, flight software's numbers and the start of the nominal run, as an estimate without error."""
    # The table of kernels is of double precision, whatever the loop is in.
    scenario, params = single_run.nominal(file.model_copy(update={"precision": "double"}))
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


def coast(scenario: Scenario, flight: FlightParams, at: OrbitEstimate) -> OrbitEstimate:
    """The true orbits a second later, by the filter's own model of them."""
    zero, none = jnp.zeros((), dtype=jnp.float64), jnp.zeros(3, dtype=jnp.float64)
    degree, dt = scenario.navigation_zonal_degree, scenario.tick_s
    return orbit_filter.predict(flight.navigation, degree, at, none, zero, zero + 1.0, none, dt)


def measured(flight: FlightParams, at: OrbitEstimate, noise: Float[Array, "6"]) -> Given:
    """What is measured of true orbits by a camera that looks at the target, with standard normal numbers."""
    tuning, focal = flight.navigation, flight.onboard.focal_px
    q_BN, _ = target_pointing.look_attitude(flight.onboard, at)
    r_TS_N = at.relative.r_TS_N
    angle = tuning.target_size / safe.norm(r_TS_N)
    pixel = tuning.edge_noise / focal
    zero, none, yes = jnp.zeros_like(angle), jnp.zeros_like(r_TS_N), jnp.ones_like(angle, dtype=bool)
    return Given(
        delta_v_N=none,
        burn_delta_v=zero,
        doubt=zero + 1.0,
        pull_N=none,
        q_KN=quaternion.multiply(quaternion.normalize(flight.onboard.camera_mounting), q_BN),
        gps=GpsMeasurement(position_N=at.servicer.r_SN_N + tuning.gps_noise * noise[:3], present=yes),
        box=BoxMeasurement(
            tangent=pixel * noise[3:5],
            log_size=jnp.log(angle) + pixel / angle * noise[5],
            side_px=angle * focal,
            present=yes,
            truncated=~yes,
            half_frame=jnp.full(2, _HALF_FRAME, dtype=jnp.float64),
            attitude_drift=zero,
        ),
    )


def record(
    scenario: Scenario, flight: FlightParams, start: OrbitEstimate, noise: Float[Array, "t 6 n"]
) -> tuple[OrbitEstimate, Given]:
    """The true orbits at the end, and all measurements on the way, time first and runs last."""
    every = _batched(measured, (None, None, -1))

    def second(at: OrbitEstimate, noise: Array) -> tuple[OrbitEstimate, Given]:
        after = coast(scenario, flight, at)
        return after, every(flight, after, noise)

    return jax.lax.scan(second, start, noise)


def follow(
    scenario: Scenario, flight: FlightParams, estimate: OrbitEstimate, track: BoxTrack, given: Given
) -> OrbitEstimate:
    """Estimates of all runs after all measurements."""
    every = _batched(lambda *own: filtered(scenario, *own), (None, None, -1, -1, -1))

    def second(carry: tuple[OrbitEstimate, BoxTrack], given: Given) -> tuple[tuple[OrbitEstimate, BoxTrack], None]:
        return every(flight.navigation, flight.onboard.focal_px, *carry, given), None

    return jax.lax.scan(second, (estimate, track), given)[0][0]


def _batched(function: Callable[..., Any], in_axes: tuple[int | None, ...]) -> Callable[..., Any]:
    """A function of one run as one of many, which lie along the last axes of its arguments and results."""
    return vmap_last_axis.batch(function, in_axes, -1)


def spread(tree: Any, runs: int) -> Any:
    """The same for every run, runs last."""
    return jax.tree.map(lambda leaf: jnp.repeat(leaf[..., None], runs, axis=-1), tree)


def prepare(file: ScenarioFile, batch: int, updates: int = UPDATES, devices: Sequence[Any] | None = None) -> Program:
    """Program that filters the measurements of `batch` runs on each device."""
    used = list(jax.devices() if devices is None else devices)
    scenario, flight, start = truth(file)
    noise = jnp.asarray(np.random.default_rng(0).standard_normal((updates, NOISES, batch)))
    _, given = jax.jit(lambda noise: record(scenario, flight, start, noise))(noise)
    share = (flight, *spread((start, outlier_gate.initial_track()), batch), given)
    return stopwatch.program(lambda *own: follow(scenario, *own), [share] * len(used), used)


def speed(file: ScenarioFile, batch: int, updates: int = UPDATES, devices: Sequence[Any] | None = None) -> FilterSpeed:
    """Time of an update with `batch` runs on each device."""
    program = prepare(file, batch, updates, devices)
    taken = program.fastest()
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


def measure(file: ScenarioFile, batches: Sequence[int] = BATCHES) -> dict[str, Any]:
    """Speeds of all batch sizes per device; the headline is that of the fastest one."""
    speeds = [speed(file, batch) for batch in batches]
    best = min(speeds, key=lambda entry: entry.us_per_update)
    return {**asdict(best), "batches": [asdict(entry) for entry in speeds]}
