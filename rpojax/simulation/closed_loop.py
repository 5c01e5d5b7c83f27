"""One closed-loop run: initial state, one tick, a rollout of many. Pure functions of one run; campaigns batch them."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import ephemeris, orbital_mechanics, random, safe
from rpojax.core.constants import MU_MOON, MU_SUN
from rpojax.core.difference import Difference
from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.pytree import pytree, replace, select
from rpojax.core.random import Stream
from rpojax.flight import (
    attitude_estimator,
    burn_plan,
    computer,
    looking,
    orbit_filter,
    relative_filter,
    servicer_filter,
)
from rpojax.flight.attitude_estimator import AttitudeEstimate
from rpojax.flight.computer import FlightMemory, Measurements, Stages
from rpojax.flight.navigation import GpsMeasurement
from rpojax.flight.orbit_filter import Innovation
from rpojax.physics import actuators, faults, plant
from rpojax.physics.actuators import Burn, BurnError
from rpojax.physics.environment import Sky
from rpojax.physics.faults import Health
from rpojax.physics.plant import Truth
from rpojax.sensors import chamber_pressure, gps, gyro, star_tracker, statistical_camera
from rpojax.sensors.box_camera import Frame
from rpojax.simulation import camera, noise
from rpojax.simulation.noise import StartNoise, TickNoise
from rpojax.simulation.params import Params
from rpojax.simulation.scenario import Scenario

Scalar = Float[Array, ""]


@pytree
class SensorState:
    """Errors that outlive a tick.

    Attributes:
        gps_bias_N: (3,) [m]
        gyro_bias_B: (3,) [rad/s]
        box_edges: (4,) what lasts of the statistical camera's errors [1 sigma], None for other cameras
    """

    gps_bias_N: Array
    gyro_bias_B: Array
    box_edges: Array | None


@pytree
class State:
    """Everything that changes during a run.

    Attributes:
        truth: the plant
        flight: memory of the flight software
        sensors: slowly varying sensor errors
        burn_error: execution error of the present burn
        keys: (streams, 2) one random key per stream
        tick: () whole ticks since the start
        failed_at: () time of failure [s], infinite while all is well
        failure: () 0 none, 1 non-finite, 2 keep-out
    """

    truth: Truth
    flight: FlightMemory
    sensors: SensorState
    burn_error: BurnError
    keys: Array
    tick: Array
    failed_at: Array
    failure: Array


@pytree
class Telemetry:
    """One tick seen from outside, after sensing and navigation.

    Attributes:
        truth: the plant
        flight: memory of the flight software
        frame: the camera's frame
        measurements: what flight software got
        innovation: diagnostics of the orbit filter
        mode: () guidance mode
        tick: () whole ticks since the start
        running: () bool, the run had not failed
    """

    truth: Truth
    flight: FlightMemory
    frame: Frame
    measurements: Measurements
    innovation: Innovation
    mode: Array
    tick: Array
    running: Array


FAILURES = ("", "non-finite state", "entered the keep-out sphere")
"""Reasons by failure code."""


def run_key(seed: int, run_id: int | Array) -> Array:
    """Random key of one run of a campaign."""
    return random.fold_in(random.master_key(seed), run_id)


def init(scenario: Scenario, params: Params, key: Array, drawn: StartNoise | None = None) -> State:
    """State at the start: truth as given, flight software from the hand-over with errors drawn from its covariance.

    The run's own random numbers are used unless others are given.
    """
    streams = jax.vmap(lambda stream: random.fold_in(key, stream))(jnp.arange(len(Stream) + 1))
    drawn = drawn or noise.draw_start(scenario, streams)
    navigation = params.flight.navigation
    identity = jnp.array([1.0, 0.0, 0.0, 0.0], dtype=jnp.float64)
    truth = plant.initial_truth(
        params.plant, params.orbit, params.initial.relative_position, params.initial.relative_velocity, identity
    )
    sensors = SensorState(
        gps_bias_N=params.gps.bias_sigma * drawn.biases[:3],
        gyro_bias_B=params.gyro.initial_bias_sigma * drawn.biases[3:],
        box_edges=drawn.box_edges,
    )
    sigma = [servicer_filter.initial_sigma(navigation)[:6], relative_filter.initial_sigma(navigation)[:6]]
    error = jnp.concatenate(sigma) * drawn.handover
    orbit = orbit_filter.initial(
        navigation,
        truth.r_TN_N + truth.r_ST_N + error[0:3],
        truth.v_TN_N + truth.v_ST_N + error[3:6],
        -truth.r_ST_N + error[6:9],
        -truth.v_ST_N + error[9:12],
    )
    q_BN, omega = looking.look_attitude(params.flight.onboard, orbit)
    truth = replace(truth, q_BN=q_BN, omega_BN_B=omega)
    star_q = star_tracker.measure(params.star_tracker, q_BN, drawn.star_tracker)
    gyro_B = gyro.measure(params.gyro, omega, sensors.gyro_bias_B, drawn.gyro, scenario.step_s)
    zero = jnp.zeros((), dtype=jnp.float64)
    return State(
        truth=truth,
        flight=computer.start(params.flight, scenario.formation_period_s, orbit, star_q, gyro_B),
        sensors=sensors,
        burn_error=BurnError(magnitude=zero, direction=jnp.zeros(3)),
        keys=streams,
        tick=jnp.zeros((), dtype=jnp.int32),
        failed_at=zero + jnp.inf,
        failure=jnp.zeros((), dtype=jnp.int32),
    )


def tick(
    stages: Stages, scenario: Scenario, params: Params, state: State, drawn: TickNoise | None = None
) -> tuple[State, Telemetry]:
    """State one tick later, and what there was to see at its beginning.

    The run's own random numbers are used unless others are given.
    """
    drawn = drawn or noise.draw(scenario, state.keys, state.tick)
    time = state.tick.astype(jnp.float64) * scenario.tick_s
    sky = sky_at(scenario, time)
    health = faults.health(params.plant.fault, time) if scenario.effects.faults else faults.healthy()
    with jax.named_scope("sense"):
        measurements, frame = _sense(scenario, params, state, drawn, sky, health)
    with jax.named_scope("navigate"):
        flight, innovation = computer.navigate(
            stages, params.flight, scenario.gated, state.flight, measurements, sky.sun_N
        )
    with jax.named_scope("plan_burn"):
        flight, burn_error = _plan_burn(stages, scenario, params, state, drawn, flight, sky, time)
    with jax.named_scope("guide"):
        flight, mode = computer.guide(params.flight, flight, innovation.accepted, sky.sun_N, time, scenario.tick_s)
    telemetry = Telemetry(
        truth=state.truth,
        flight=flight,
        frame=frame,
        measurements=measurements,
        innovation=innovation,
        mode=mode,
        tick=state.tick,
        running=jnp.isinf(state.failed_at),
    )
    with jax.named_scope("act"):
        truth, flight, sensors = _act(stages, scenario, params, state, drawn, flight, burn_error, sky, health, time)
    after = replace(state, truth=truth, flight=flight, sensors=sensors, burn_error=burn_error)
    with jax.named_scope("check"):
        after = _freeze_if_failed(params, state, after, time)
    return replace(after, tick=state.tick + 1), telemetry


def rollout(
    scenario: Scenario, params: Params, state: State, ticks: int, stages: Stages | None = None
) -> tuple[State, Telemetry]:
    """State after `ticks` ticks and their telemetry, time first."""
    chosen = stages or Stages()

    def body(carry: State, _: None) -> tuple[State, Telemetry]:
        return tick(chosen, scenario, params, carry)

    return jax.lax.scan(body, state, None, length=ticks)


def sky_at(scenario: Scenario, time: Scalar) -> Sky:
    """Sun and Moon at `time` [s]; the same for all runs of a campaign, so they cost next to nothing."""
    seconds = scenario.epoch_s + time
    return Sky(sun_N=ephemeris.sun(seconds), moon_N=ephemeris.moon(seconds))


def _sense(
    scenario: Scenario, params: Params, state: State, drawn: TickNoise, sky: Sky, health: Health
) -> tuple[Measurements, Frame]:
    truth = state.truth
    frame = camera.expose(
        scenario,
        params,
        truth,
        state.flight,
        state.sensors.box_edges,
        sky,
        health,
        drawn,
        noise.camera_key(state.keys, state.tick),
        state.tick,
    )
    measurements = Measurements(
        gps=GpsMeasurement(
            position_N=gps.measure(params.gps, truth.r_TN_N + truth.r_ST_N, state.sensors.gps_bias_N, drawn.gps),
            present=health.gps,
        ),
        star_tracker_q_BN=star_tracker.measure(params.star_tracker, truth.q_BN, drawn.star_tracker),
        star_tracker_present=health.star_tracker & star_tracker.sees_stars(params.star_tracker, truth.q_BN, sky.sun_N),
        box=camera.as_measurement(scenario, params, frame),
    )
    return measurements, frame


def _plan_burn(
    stages: Stages,
    scenario: Scenario,
    params: Params,
    state: State,
    drawn: TickNoise,
    flight: FlightMemory,
    sky: Sky,
    time: Scalar,
) -> tuple[FlightMemory, BurnError]:
    """A new burn on decision ticks. The tick is the same for all runs of a batch, so this is a true branch."""

    def decide(flight: FlightMemory) -> tuple[burn_plan.BurnPlan, BurnError]:
        error = actuators.draw_burn_error(params.plant.thruster, drawn.burn)
        return computer.plan_burn(stages, params.flight, flight, sky.sun_N, time).plan, error

    def keep(flight: FlightMemory) -> tuple[burn_plan.BurnPlan, BurnError]:
        return flight.plan, state.burn_error

    due = state.tick % scenario.formation_ticks == 0
    plan, error = jax.lax.cond(due, decide, keep, flight)
    return replace(flight, plan=plan), error


def _act(
    stages: Stages,
    scenario: Scenario,
    params: Params,
    state: State,
    drawn: TickNoise,
    flight: FlightMemory,
    burn_error: BurnError,
    sky: Sky,
    health: Health,
    time: Scalar,
) -> tuple[Truth, FlightMemory, SensorState]:
    """Attitude control and plant over one tick, then both filters carried to its end."""
    dt = scenario.step_s
    plan = flight.plan
    effects = scenario.effects
    offsets = jnp.arange(scenario.substeps, dtype=jnp.float64) * dt

    def substep(
        carry: tuple[Truth, AttitudeEstimate, Array], inputs: tuple[Array, Array]
    ) -> tuple[tuple[Truth, computer.AttitudeEstimate, Array], None]:
        truth, attitude, delta_v_N = carry
        offset, gyro_normals = inputs
        now = replace(flight, attitude=attitude)
        torque = computer.control_attitude(stages, params.flight, now, truth.wheel_speed, offset)
        begin = time + offset
        burn = Burn(ignition=plan.ignition - begin, cutoff=plan.cutoff - begin, error=burn_error)
        delta_v_N = delta_v_N + computer.delta_v_between(params.flight, now, begin, begin + dt)
        thrust = actuators.thrust(params.plant.thruster, burn, effects.integrator, effects.thruster_ramps, dt)
        truth = plant.step(effects, params.plant, truth, torque, (thrust,), sky, health, dt)
        sample = gyro.measure(params.gyro, truth.omega_BN_B, state.sensors.gyro_bias_B, gyro_normals, dt)
        return (truth, attitude_estimator.integrate_gyro(attitude, sample, dt), delta_v_N), None

    start = (state.truth, flight.attitude, jnp.zeros(3))
    (truth, attitude, delta_v_N), _ = jax.lax.scan(substep, start, (offsets, drawn.gyro))
    moved = replace(flight, attitude=attitude)
    ratio = _chamber_pressure(params, drawn, burn_error, health) if effects.faults else jnp.ones_like(time)
    pull_N = _luni_solar_pull(scenario, flight, sky)
    end = time + scenario.tick_s
    flight = computer.predict(
        stages,
        params.flight,
        scenario.navigation_zonal_degree,
        moved,
        flight.attitude.q_BN,
        delta_v_N,
        ratio,
        pull_N,
        end,
        scenario.tick_s,
    )
    return truth, flight, _advance_sensors(scenario, params, state, drawn)


def _luni_solar_pull(scenario: Scenario, flight: FlightMemory, sky: Sky) -> Array:
    """Pull [m/s^2] of Sun and Moon on the servicer, as flight software works it out from its almanac."""
    r = Difference(value=flight.orbit.servicer.r_SN_N, change=jnp.zeros(3))
    pull = jnp.zeros(3)
    if scenario.navigation_luni_solar:
        for mu, body_N in ((MU_SUN, sky.sun_N), (MU_MOON, sky.moon_N)):
            pull = pull + orbital_mechanics.distant_pull(mu, body_N, r).value
    return pull


def _chamber_pressure(params: Params, drawn: TickNoise, burn_error: BurnError, health: Health) -> Scalar:
    thrust = params.plant.thruster.force_scale * (1.0 + burn_error.magnitude) * health.thrust
    return chamber_pressure.measure(thrust, drawn.chamber_pressure)


def _advance_sensors(scenario: Scenario, params: Params, state: State, drawn: TickNoise) -> SensorState:
    box_edges = state.sensors.box_edges
    if box_edges is not None:
        assert params.statistics is not None
        assert drawn.box_edges is not None
        turned = safe.norm(state.truth.omega_TN_T) * scenario.tick_s
        box_edges = statistical_camera.advance(params.statistics, box_edges, turned, drawn.box_edges)
    return SensorState(
        gps_bias_N=gps.advance_bias(params.gps, state.sensors.gps_bias_N, drawn.biases[:3], scenario.tick_s),
        gyro_bias_B=gyro.advance_bias(params.gyro, state.sensors.gyro_bias_B, drawn.biases[3:], scenario.tick_s),
        box_edges=box_edges,
    )


def _freeze_if_failed(params: Params, before: State, after: State, time: Scalar) -> State:
    """The new state, or the old one for a run that has failed now or earlier."""
    finite = safe.is_finite((after.truth, after.flight.orbit, after.flight.attitude))
    inside = jnp.sum(after.truth.r_ST_N**2, axis=0) < params.limits.keep_out**2
    code = jnp.where(~finite, 1, jnp.where(inside, 2, 0)).astype(jnp.int32)
    was_running = before.failure == 0
    running = was_running & (code == 0)
    kept = select(running, after, replace(before, keys=after.keys))
    return replace(
        kept,
        failure=jnp.where(was_running, code, before.failure),
        failed_at=jnp.where(was_running & (code != 0), time, before.failed_at),
        tick=before.tick,
        keys=before.keys,
    )


def relative_state(truth: Truth) -> tuple[Array, Array]:
    """True `rho_H` [m] and `rho_dot_H` [m/s]."""
    R_HN, omega_HN_N = hill_frame(truth.r_TN_N, truth.v_TN_N)
    return inertial_to_hill(truth.r_ST_N, truth.v_ST_N, R_HN, omega_HN_N)


__all__ = [
    "FAILURES",
    "State",
    "Telemetry",
    "init",
    "relative_state",
    "rollout",
    "run_key",
    "sky_at",
    "tick",
]
