"""Stages of one tick in their order: each takes the tick from the stage before it and hands it on."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.batching.jax_programs import any_of_batch
from rpojax.core.constants import MU_MOON, MU_SUN
from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.orbits import third_body_gravity
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions, sun_and_moon_at
from rpojax.core.pytree import replace, select
from rpojax.flight import computer, tick_prediction
from rpojax.flight.control import thruster_isolation
from rpojax.flight.decisions import burn_decision, mission_decision, translation
from rpojax.flight.decisions.motion_prediction import predict_to_burn
from rpojax.flight.flight_records import FlightMemory
from rpojax.flight.guidance import burn_schedule, target_pointing
from rpojax.flight.mission.mission_state import MissionState
from rpojax.flight.navigation import attitude_ekf
from rpojax.physics import equipment_faults, plant
from rpojax.physics.equipment_faults import Health
from rpojax.physics.plant_state import Truth
from rpojax.physics.thruster import BurnError, ValveCommand, draw_burn_error, thrust_over_step
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors import chamber_pressure, gyro
from rpojax.simulation import command_delay, reaction_control
from rpojax.simulation.noise import TickNoise, draw_tick_noise
from rpojax.simulation.outcomes.freezing import freeze_if_failed
from rpojax.simulation.state import State, elapsed_time
from rpojax.simulation.tick import Loop, Motion, Tick
from rpojax.simulation.tick_measurements import advance_sensor_errors, measure, measure_chamber_pressure

Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


def command_camera(loop: Loop, state: State) -> State:
    """The state with the flight software's command for the exposure that begins the tick."""
    time = elapsed_time(loop.scenario, state.truth, state.tick)
    with jax.named_scope("command"):
        flight = computer.command_camera(loop.software, state.flight, time)
    return replace(state, flight=flight)


def sense(loop: Loop, state: State, noise: TickNoise | None = None) -> Tick:
    """Measurements at the beginning of a tick; the random numbers are by default those of the run's keys."""
    scenario, params = loop.scenario, loop.params
    with jax.named_scope("draw"):
        noise = noise or draw_tick_noise(scenario, state.keys, state.tick)
    time = elapsed_time(scenario, state.truth, state.tick)
    sky = sun_and_moon_at(params.epoch, time)
    health = (
        equipment_faults.health_at(params.plant.faults, time) if scenario.effects.faults else equipment_faults.healthy()
    )
    if scenario.thrusters:
        # Faults of thrusters are those of some of the list.
        health = replace(health, thrust_fraction=jnp.ones_like(health.thrust_fraction))
    health = _fed(params, state.truth, health)
    thrusters = reaction_control.true_thrusters(loop, state.truth, noise, time) if scenario.thrusters else None
    with jax.named_scope("sense"):
        measurements, frame, in_transit = measure(loop, state, noise, sky, health, time)
    return Tick(
        state=replace(state, in_transit=in_transit),
        time=time,
        sky=sky,
        health=health,
        noise=noise,
        frame=frame,
        measurements=measurements,
        flight=state.flight,
        burn_error=state.burn_error,
        thrusters=thrusters,
    )


def navigate(loop: Loop, tick: Tick) -> Tick:
    """Measurement updates of orbit and attitude filter."""
    with jax.named_scope("navigate"):
        memory, innovation = computer.navigate(loop.software, tick.flight, tick.measurements, tick.sky.sun_N, tick.time)
    return replace(tick, flight=memory, innovation=innovation)


def manage_mission(loop: Loop, tick: Tick) -> Tick:
    """Phase of the mission, reconsidered on decision ticks."""
    if not loop.scenario.mission.is_managed:
        return tick
    with jax.named_scope("manage_mission"):
        state = jax.lax.cond(
            tick.state.tick % loop.scenario.mission.decision_ticks == 0,
            lambda memory: mission_decision.manage_mission(loop.software, memory, tick.time),
            lambda memory: memory.mission,
            tick.flight,
        )
    return replace(tick, flight=replace(tick.flight, mission=state))


def plan_burn(loop: Loop, tick: Tick) -> Tick:
    """Burn plan, renewed on decision ticks, and execution error of the present burn.

    The number of the tick is equal for all runs of a batch, and so is whether a phase of any of them decides about
    burns, so that the branch stays one under `vmap`.
    """
    flight, scenario = loop.params.flight, loop.scenario
    mission = scenario.mission
    due = tick.state.tick % mission.decision_ticks == 0
    is_of_phase = burn_decision.is_due(mission, tick.flight.mission, tick.time, scenario.tick_s)

    def decide(memory: FlightMemory) -> tuple[burn_schedule.BurnPlan, BurnError, MissionState]:
        decision = burn_decision.Decision(
            time=tick.time,
            memory=memory,
            predicted=predict_to_burn(flight, memory.orbit),
            pointing=pointing,
            team=None if tick.peers is None else burn_decision.Team(tuning=loop.params.team, peers=tick.peers),
        )
        plan, state = burn_decision.plan_burn(loop.software, decision)
        error = draw_burn_error(loop.params.plant.thruster, tick.noise.burn)
        return select(is_of_phase, (plan, error, state), keep(memory))

    def keep(memory: FlightMemory) -> tuple[burn_schedule.BurnPlan, BurnError, MissionState]:
        return memory.plan, tick.burn_error, memory.mission

    with jax.named_scope("plan_burn"):
        # Outside of the branch, so that XLA shares it with guidance.
        pointing = target_pointing.point_at_target(
            flight.vehicle, tick.flight.orbit, tick.flight.pointing.reference.q_EN, tick.sky.sun_N
        )
        other = mission_decision.other_pointing(loop.software, tick.flight, tick.sky.sun_N)
        pointing = target_pointing.with_other(pointing, other)
        plan, error, state = jax.lax.cond(due & any_of_batch(is_of_phase), decide, keep, tick.flight)
    return replace(tick, flight=replace(tick.flight, plan=plan, mission=state), burn_error=error)


def translate(loop: Loop, tick: Tick) -> Tick:
    """Command of the reaction control system for the tick, where the servicer has one."""
    if loop.params.flight.thrusters is None:
        return tick
    with jax.named_scope("translate"):
        flight = translation.command(loop.software, tick.flight, tick.state.truth.wheel_speed, tick.time)
    return replace(tick, flight=flight)


def guide(loop: Loop, tick: Tick) -> Tick:
    """Attitude reference of the tick, and the pointing mode."""
    assert tick.innovation is not None
    seen = tick.innovation.is_used(loop.scenario.direction_sensors)
    if tick.confirmed is not None:
        seen = seen | tick.confirmed
    with jax.named_scope("guide"):
        memory, mode = computer.guide(loop.software, tick.flight, seen, tick.sky.sun_N, tick.time)
    return replace(tick, flight=memory, mode=mode)


def control_and_propagate(loop: Loop, tick: Tick) -> Motion:
    """State of the vehicle at the end of the tick, under the attitude control of the flight software."""

    def plant_step(motion: Motion, inputs: tuple[Array, Array, Array | None]) -> tuple[Motion, None]:
        offset, gyro_normals, pressure_normals = inputs
        torque = wheel_torque_command(loop, tick, motion, offset)
        return propagate_substep(loop, tick, motion, torque, offset, gyro_normals, pressure_normals), None

    with jax.named_scope("act"):
        inputs = (substep_offsets(loop.scenario), tick.noise.gyro, tick.noise.pressures_at_rest)
        return jax.lax.scan(plant_step, initial_motion(tick), inputs)[0]


def substep_offsets(scenario: Scenario) -> Float[Array, " substeps"]:
    """Times of the plant steps of a tick since its beginning [s]."""
    return jnp.arange(scenario.substeps, dtype=jnp.float64) * scenario.step_s


def initial_motion(tick: Tick) -> Motion:
    """State of the vehicle before the first plant step of a tick."""
    rcs = tick.flight.rcs
    return Motion(
        truth=tick.state.truth,
        attitude=tick.flight.attitude,
        delta_v_N=jnp.zeros(3),
        owed=None if rcs is None else rcs.owed,
        fired=None if rcs is None else jnp.zeros_like(rcs.owed),
        isolation=None if rcs is None else rcs.isolation,
        uncommanded=None if rcs is None or rcs.isolation is None else thruster_isolation.never_open(rcs.isolation),
        commands=tick.state.commands,
    )


def wheel_torque_command(loop: Loop, tick: Tick, motion: Motion, offset: Scalar) -> Vector:
    """Commanded wheel torques [N m] `offset` [s] after the beginning of the tick."""
    now = replace(tick.flight, attitude=motion.attitude)
    return computer.control_attitude(loop.software, now, motion.truth.wheel_speed, offset, tick.time + offset)


def propagate_substep(
    loop: Loop,
    tick: Tick,
    motion: Motion,
    torque: Vector,
    offset: Scalar,
    gyro_normals: Vector,
    pressure_normals: Float[Array, " n"] | None = None,
) -> Motion:
    """State of the vehicle one plant step later.

    Args:
        loop: closed loop of the run
        tick: after guidance
        motion: before the step
        torque: (3,) wheel torques, constant over the step [N m]
        offset: () time of the step since the beginning of the tick [s]
        gyro_normals: (3,) standard normal numbers
        pressure_normals: (n,) the same, of pressures while no pulse is commanded; None where these are not watched
    """
    params, dt, effects, plan = loop.params, loop.scenario.step_s, loop.scenario.effects, tick.flight.plan
    now = replace(tick.flight, attitude=motion.attitude)
    # Times relative to the step, because in single precision times since the start are too coarse.
    ignition, cutoff = plan.ignition - tick.time - offset, plan.cutoff - tick.time - offset
    if motion.commands is not None:
        ignition, cutoff = (each + loop.scenario.command_steps * dt for each in (ignition, cutoff))
        torque, waiting = command_delay.exchanged(motion.commands.torque, torque)
        motion = replace(motion, commands=replace(motion.commands, torque=waiting))
    if tick.flight.rcs is not None:
        cutoff = jnp.where(tick.flight.rcs.acts, ignition, cutoff)
    burn = ValveCommand(ignition=ignition, cutoff=cutoff, burn_error=tick.burn_error)
    delta_v_N = motion.delta_v_N + tick_prediction.expected_delta_v(params.flight, now, ignition, cutoff, dt)
    thrust = thrust_over_step(params.plant.thruster, burn, effects.integrator, effects.thruster_ramps, dt)
    health = _fed(params, motion.truth, tick.health)
    rcs = on_time = None
    after = replace(motion, delta_v_N=delta_v_N)
    if tick.flight.rcs is not None:
        rcs, after, on_time = reaction_control.pulses(loop, tick, after, offset)
    truth = plant.step(effects, params.plant, motion.truth, torque, (thrust,), tick.sky, health, dt, rcs)
    gyro_bias_B = tick.state.sensor_errors.gyro_bias_B
    sample = gyro.measure(params.gyro, truth.omega_BN_B, gyro_bias_B, gyro_normals, dt)
    turned = None
    if rcs is not None:
        # Pulses change the rate within a step, of which two samples do not tell the mean: a gyro adds up the angle.
        mean_B = gyro.mean_rate(motion.truth.q_BN, truth.q_BN, dt)
        turned = gyro.measure(params.gyro, mean_B, gyro_bias_B, gyro_normals, dt)
    attitude = attitude_ekf.integrate_gyro(motion.attitude, sample, dt, turned)
    if motion.isolation is not None:
        assert on_time is not None
        assert pressure_normals is not None
        after = reaction_control.watched(loop, tick, after, on_time, offset, pressure_normals)
    return replace(after, truth=truth, attitude=attitude)


def finish(loop: Loop, tick: Tick, motion: Motion) -> State:
    """State at the beginning of the next tick: filter predictions, propagated sensor errors, failure check."""
    with jax.named_scope("act"):
        flight = _predict(loop, tick, motion)
        sensors = advance_sensor_errors(loop.scenario, loop.params, tick.state, tick.noise)
    after = replace(
        tick.state,
        truth=motion.truth,
        flight=flight,
        sensor_errors=sensors,
        burn_error=tick.burn_error,
        commands=motion.commands,
    )
    with jax.named_scope("check"):
        after = freeze_if_failed(loop.params, tick.state, after, tick.time)
    return replace(after, tick=tick.state.tick + 1)


def _fed(params: Params, truth: Truth, health: Health) -> Health:
    """Health of the equipment; the thruster works as long as propellant is left."""
    return equipment_faults.with_propellant(health, reaction_control.has_propellant(params, truth))


def _predict(loop: Loop, tick: Tick, motion: Motion) -> FlightMemory:
    """Memory of the flight software propagated to the end of the tick."""
    scenario, params = loop.scenario, loop.params
    thrust_ratio = pressures = None
    if scenario.chamber_pressure and scenario.thrusters:
        assert tick.noise.thrusters is not None
        assert tick.thrusters is not None
        ratio = jnp.where(reaction_control.has_propellant(params, motion.truth), tick.thrusters.ratio, 0.0)
        pressures = chamber_pressure.measure(params.chamber_pressure, ratio, tick.noise.thrusters[scenario.thrusters :])
    if scenario.chamber_pressure:
        thrust_ratio = measure_chamber_pressure(params, tick.noise, tick.burn_error, tick.health)
    on_board = tick_prediction.MotionOnBoard(
        q_BN_before=tick.flight.attitude.q_BN,
        delta_v_N=motion.delta_v_N,
        thrust_ratio=thrust_ratio,
        third_body_acceleration_N=_luni_solar_acceleration(scenario, tick.flight, tick.sky),
        sun_N=tick.sky.sun_N,
        fired=motion.fired,
        pressures=pressures,
        uncommanded=motion.uncommanded,
    )
    memory = replace(tick.flight, attitude=motion.attitude)
    if memory.rcs is not None:
        memory = replace(memory, rcs=replace(memory.rcs, owed=motion.owed, isolation=motion.isolation))
    return tick_prediction.predict(loop.software, memory, on_board, tick.time + scenario.tick_s)


def _luni_solar_acceleration(scenario: Scenario, flight: FlightMemory, sky: SunMoonPositions) -> Array:
    """Third-body acceleration [m/s^2] of the servicer by Sun and Moon, from the ephemeris on board."""
    r = Difference(value=flight.orbit.servicer.r_SN_N, change=jnp.zeros(3))
    acceleration_N = jnp.zeros(3)
    if scenario.navigation_luni_solar:
        for mu, body_N in ((MU_SUN, sky.sun_N), (MU_MOON, sky.moon_N)):
            acceleration_N = acceleration_N + third_body_gravity.third_body_acceleration(mu, body_N, r).value
    return acceleration_N
