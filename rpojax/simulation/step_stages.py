"""Stages of one tick in their order, composed by `step.step`, and one by one by `cosimulation_stages`."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.constants import MU_MOON, MU_SUN
from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.orbits import sun_moon_ephemeris, third_body_gravity
from rpojax.core.pytree import pytree, replace
from rpojax.flight import computer
from rpojax.flight.computer import FlightMemory, Measurements, Stages
from rpojax.flight.guidance import burn_planning, target_pointing
from rpojax.flight.navigation import attitude_ekf
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.flight.navigation.combined_orbit_filter import Innovation
from rpojax.physics import equipment_faults, plant
from rpojax.physics.environment.sun_moon_positions import SunMoonPositions
from rpojax.physics.equipment_faults import Health
from rpojax.physics.plant_state import Truth
from rpojax.physics.thruster import BurnError, ValveCommand, draw_burn_error, thrust_over_step
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors import gyro
from rpojax.sensors.camera import CameraFrame
from rpojax.simulation.failure import freeze_if_failed
from rpojax.simulation.noise import TickNoise, draw_tick_noise
from rpojax.simulation.state import State
from rpojax.simulation.telemetry import Telemetry
from rpojax.simulation.tick_measurements import advance_sensor_errors, measure, measure_chamber_pressure

Flag = Bool[Array, ""]
Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class SensedTick:
    """A tick after sensing.

    Attributes:
        time: () since the start of the run [s]
        sky: positions of Sun and Moon
        health: of the equipment
        noise: random numbers of the tick
        measurements: inputs of the flight software
        frame: camera frame
    """

    time: Array
    sky: SunMoonPositions
    health: Health
    noise: TickNoise
    measurements: Measurements
    frame: CameraFrame


@pytree
class GuidedTick:
    """A tick after navigation, burn planning and guidance.

    Attributes:
        sensed: the tick after sensing
        flight: memory of the flight software
        burn_error: execution error of the present burn
    """

    sensed: SensedTick
    flight: FlightMemory
    burn_error: BurnError


@pytree
class Motion:
    """State of the vehicle between two plant steps of a tick.

    Attributes:
        truth: state of the plant
        attitude: estimate propagated by the gyro
        delta_v_N: (3,) velocity change in this tick as expected by the flight software [m/s]
    """

    truth: Truth
    attitude: AttitudeEstimate
    delta_v_N: Array


def sun_and_moon_at(scenario: Scenario, time: Scalar) -> SunMoonPositions:
    """Positions of Sun and Moon at `time` [s] since the start; equal for all runs of a batch."""
    epoch = scenario.epoch_s
    return SunMoonPositions(
        sun_N=sun_moon_ephemeris.sun_position(time, epoch), moon_N=sun_moon_ephemeris.moon_position(time, epoch)
    )


def sense(scenario: Scenario, params: Params, state: State, noise: TickNoise | None = None) -> SensedTick:
    """Measurements at the beginning of a tick; the random numbers are by default those of the run's keys."""
    with jax.named_scope("draw"):
        noise = noise or draw_tick_noise(scenario, state.keys, state.tick)
    time = state.tick.astype(jnp.float64) * scenario.tick_s
    sky = sun_and_moon_at(scenario, time)
    health = (
        equipment_faults.health_at(params.plant.fault, time) if scenario.effects.faults else equipment_faults.healthy()
    )
    with jax.named_scope("sense"):
        measurements, frame = measure(scenario, params, state, noise, sky, health)
    return SensedTick(time=time, sky=sky, health=health, noise=noise, measurements=measurements, frame=frame)


def navigate(
    stages: Stages, scenario: Scenario, params: Params, state: State, sensed: SensedTick
) -> tuple[FlightMemory, Innovation]:
    """Measurement updates of orbit and attitude filter: flight memory, and innovation of the orbit filter."""
    with jax.named_scope("navigate"):
        return computer.navigate(
            stages, params.flight, scenario.box_gating, state.flight, sensed.measurements, sensed.sky.sun_N
        )


def plan_burn(
    stages: Stages, scenario: Scenario, params: Params, state: State, sensed: SensedTick, flight: FlightMemory
) -> tuple[FlightMemory, BurnError]:
    """Burn plan, renewed on decision ticks, and execution error of the present burn.

    The tick is equal for all runs of a batch, so that the branch stays one under `vmap`.
    """

    def decide(flight: FlightMemory) -> tuple[burn_planning.BurnPlan, BurnError]:
        error = draw_burn_error(params.plant.thruster, sensed.noise.burn)
        return computer.plan_burn(stages, params.flight, flight, pointing, sensed.time).plan, error

    def keep(flight: FlightMemory) -> tuple[burn_planning.BurnPlan, BurnError]:
        return flight.plan, state.burn_error

    with jax.named_scope("plan_burn"):
        # Outside of the branch, so that XLA shares it with guidance.
        pointing = target_pointing.point_at_target(params.flight.vehicle, flight.orbit, sensed.sky.sun_N)
        due = state.tick % scenario.formation_ticks == 0
        plan, error = jax.lax.cond(due, decide, keep, flight)
        return replace(flight, plan=plan), error


def guide(
    scenario: Scenario, params: Params, sensed: SensedTick, flight: FlightMemory, box_accepted: Flag
) -> tuple[FlightMemory, Array]:
    """Flight memory with the attitude reference of the tick, and the pointing mode."""
    with jax.named_scope("guide"):
        return computer.guide(params.flight, flight, box_accepted, sensed.sky.sun_N, sensed.time, scenario.tick_s)


def make_telemetry(
    state: State, sensed: SensedTick, flight: FlightMemory, innovation: Innovation, mode: Array
) -> Telemetry:
    """Telemetry of a tick after guidance."""
    return Telemetry(
        truth=state.truth,
        flight=flight,
        frame=sensed.frame,
        measurements=sensed.measurements,
        innovation=innovation,
        mode=mode,
        tick=state.tick,
        running=jnp.isinf(state.failed_at),
    )


def substep_offsets(scenario: Scenario) -> Float[Array, " substeps"]:
    """Times of the plant steps of a tick since its beginning [s]."""
    return jnp.arange(scenario.substeps, dtype=jnp.float64) * scenario.step_s


def initial_motion(state: State, guided: GuidedTick) -> Motion:
    """State of the vehicle before the first plant step of a tick."""
    return Motion(truth=state.truth, attitude=guided.flight.attitude, delta_v_N=jnp.zeros(3))


def wheel_torque_command(
    stages: Stages, params: Params, flight: FlightMemory, motion: Motion, offset: Scalar
) -> Vector:
    """Commanded wheel torques [N m] `offset` [s] after the beginning of the tick."""
    now = replace(flight, attitude=motion.attitude)
    return computer.control_attitude(stages, params.flight, now, motion.truth.wheel_speed, offset)


def propagate_substep(
    scenario: Scenario,
    params: Params,
    state: State,
    guided: GuidedTick,
    motion: Motion,
    torque: Vector,
    offset: Scalar,
    gyro_normals: Vector,
) -> Motion:
    """State of the vehicle one plant step later.

    Args:
        scenario: static settings
        params: parameters of the run
        state: at the beginning of the tick
        guided: the tick after guidance
        motion: before the step
        torque: (3,) wheel torques, constant over the step [N m]
        offset: () time of the step since the beginning of the tick [s]
        gyro_normals: (3,) standard normal numbers
    """
    dt, effects, plan, sensed = scenario.step_s, scenario.effects, guided.flight.plan, guided.sensed
    now = replace(guided.flight, attitude=motion.attitude)
    # Times relative to the step, because in single precision times since the start are too coarse.
    ignition, cutoff = plan.ignition - sensed.time - offset, plan.cutoff - sensed.time - offset
    burn = ValveCommand(ignition=ignition, cutoff=cutoff, burn_error=guided.burn_error)
    delta_v_N = motion.delta_v_N + computer.expected_delta_v(params.flight, now, ignition, cutoff, dt)
    thrust = thrust_over_step(params.plant.thruster, burn, effects.integrator, effects.thruster_ramps, dt)
    truth = plant.step(effects, params.plant, motion.truth, torque, (thrust,), sensed.sky, sensed.health, dt)
    sample = gyro.measure(params.gyro, truth.omega_BN_B, state.sensor_errors.gyro_bias_B, gyro_normals, dt)
    attitude = attitude_ekf.integrate_gyro(motion.attitude, sample, dt)
    return Motion(truth=truth, attitude=attitude, delta_v_N=delta_v_N)


def control_and_propagate(
    stages: Stages, scenario: Scenario, params: Params, state: State, guided: GuidedTick
) -> Motion:
    """State of the vehicle at the end of the tick, under the attitude control of the flight software."""

    def plant_step(motion: Motion, inputs: tuple[Array, Array]) -> tuple[Motion, None]:
        offset, gyro_normals = inputs
        torque = wheel_torque_command(stages, params, guided.flight, motion, offset)
        return propagate_substep(scenario, params, state, guided, motion, torque, offset, gyro_normals), None

    with jax.named_scope("act"):
        inputs = (substep_offsets(scenario), guided.sensed.noise.gyro)
        return jax.lax.scan(plant_step, initial_motion(state, guided), inputs)[0]


def finish(
    stages: Stages, scenario: Scenario, params: Params, state: State, guided: GuidedTick, motion: Motion
) -> State:
    """State at the beginning of the next tick: filter predictions, propagated sensor errors, failure check."""
    sensed, flight, burn_error = guided.sensed, guided.flight, guided.burn_error
    with jax.named_scope("act"):
        propagated = replace(flight, attitude=motion.attitude)
        ratio = jnp.ones_like(sensed.time)
        if scenario.effects.faults:
            ratio = measure_chamber_pressure(params, sensed.noise, burn_error, sensed.health)
        acceleration_N = _luni_solar_acceleration(scenario, flight, sensed.sky)
        after_flight = computer.predict(
            stages,
            params.flight,
            scenario.navigation_zonal_degree,
            propagated,
            flight.attitude.q_BN,
            motion.delta_v_N,
            ratio,
            acceleration_N,
            sensed.time + scenario.tick_s,
            scenario.tick_s,
        )
        sensors = advance_sensor_errors(scenario, params, state, sensed.noise)
    after = replace(state, truth=motion.truth, flight=after_flight, sensor_errors=sensors, burn_error=burn_error)
    with jax.named_scope("check"):
        after = freeze_if_failed(params, state, after, sensed.time)
    return replace(after, tick=state.tick + 1)


def _luni_solar_acceleration(scenario: Scenario, flight: FlightMemory, sky: SunMoonPositions) -> Array:
    """Third-body acceleration [m/s^2] of the servicer by Sun and Moon, from the ephemeris on board."""
    r = Difference(value=flight.orbit.servicer.r_SN_N, change=jnp.zeros(3))
    acceleration_N = jnp.zeros(3)
    if scenario.navigation_luni_solar:
        for mu, body_N in ((MU_SUN, sky.sun_N), (MU_MOON, sky.moon_N)):
            acceleration_N = acceleration_N + third_body_gravity.third_body_acceleration(mu, body_N, r).value
    return acceleration_N
