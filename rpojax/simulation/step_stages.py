"""The stages of one tick, in the order in which they run; `closed_loop.tick` puts them together.

Each is a pure function of one run, so that somebody else may step a run from outside, stage by stage.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from rpojax.core.constants import MU_MOON, MU_SUN
from rpojax.core.numerics import double_single, safe
from rpojax.core.numerics.exact_difference import Difference
from rpojax.core.orbits import orbital_mechanics, sun_moon_ephemeris
from rpojax.core.pytree import pytree, replace, select
from rpojax.flight import computer
from rpojax.flight.computer import FlightMemory, Measurements, Stages
from rpojax.flight.guidance import burn_planning, target_pointing
from rpojax.flight.navigation import attitude_ekf
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.flight.navigation.filter_tuning import GpsMeasurement
from rpojax.flight.navigation.orbit_filter import Innovation
from rpojax.physics import actuators, equipment_faults, plant
from rpojax.physics.actuators import BurnError, ValveCommand
from rpojax.physics.environment import SunMoonPositions
from rpojax.physics.equipment_faults import Health
from rpojax.physics.plant import Truth
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.sensors import chamber_pressure, gps, gyro, star_tracker, statistical_camera
from rpojax.sensors.geometric_camera import CameraFrame
from rpojax.simulation import camera_models, noise
from rpojax.simulation.noise import TickNoise
from rpojax.simulation.state import SensorErrors, State, Telemetry

Flag = Bool[Array, ""]
Scalar = Float[Array, ""]
Vector = Float[Array, "3"]


@pytree
class SensedTick:
    """How a tick begins: its surroundings, its random numbers and what the sensors give.

    Attributes:
        time: () since the start of the run [s]
        sky: Sun and Moon
        health: of the equipment
        drawn: random numbers
        measurements: for the flight software
        frame: the camera's frame
    """

    time: Array
    sky: SunMoonPositions
    health: Health
    noise: TickNoise
    measurements: Measurements
    frame: CameraFrame


@pytree
class GuidedTick:
    """A tick after planning and guidance.

    Attributes:
        sensed: how it began
        flight: memory of the flight software
        burn_error: execution error of the present burn
    """

    sensed: SensedTick
    flight: FlightMemory
    burn_error: BurnError


@pytree
class Motion:
    """What goes on within a tick.

    Attributes:
        truth: the plant
        attitude: as estimated by the gyro
        delta_v_N: (3,) velocity change that flight software expects so far in this tick [m/s]
    """

    truth: Truth
    attitude: AttitudeEstimate
    delta_v_N: Array


def sky_at(scenario: Scenario, time: Scalar) -> SunMoonPositions:
    """Sun and Moon at `time` [s]; the same for all runs of a campaign, so they cost next to nothing."""
    epoch = scenario.epoch_s
    return SunMoonPositions(
        sun_N=sun_moon_ephemeris.sun_position(time, epoch), moon_N=sun_moon_ephemeris.moon_position(time, epoch)
    )


def sense(scenario: Scenario, params: Params, state: State, drawn: TickNoise | None = None) -> SensedTick:
    """What there is to measure as a tick begins, with the run's own random numbers unless others are given."""
    with jax.named_scope("draw"):
        drawn = drawn or noise.draw_tick_noise(scenario, state.keys, state.tick)
    time = state.tick.astype(jnp.float64) * scenario.tick_s
    sky = sky_at(scenario, time)
    health = (
        equipment_faults.health_at(params.plant.fault, time) if scenario.effects.faults else equipment_faults.healthy()
    )
    with jax.named_scope("sense"):
        measurements, frame = _measure(scenario, params, state, drawn, sky, health)
    return SensedTick(time=time, sky=sky, health=health, noise=drawn, measurements=measurements, frame=frame)


def navigate(
    stages: Stages, scenario: Scenario, params: Params, state: State, sensed: SensedTick
) -> tuple[FlightMemory, Innovation]:
    """Flight memory after both filters have taken in the tick's measurements."""
    with jax.named_scope("navigate"):
        return computer.navigate(
            stages, params.flight, scenario.box_gating, state.flight, sensed.measurements, sensed.sky.sun_N
        )


def plan_burn(
    stages: Stages, scenario: Scenario, params: Params, state: State, sensed: SensedTick, flight: FlightMemory
) -> tuple[FlightMemory, BurnError]:
    """A new burn on decision ticks. The tick is the same for all runs of a batch, so this is a true branch."""

    def decide(flight: FlightMemory) -> tuple[burn_planning.BurnPlan, BurnError]:
        error = actuators.draw_burn_error(params.plant.thruster, sensed.noise.burn)
        return computer.plan_burn(stages, params.flight, flight, sight, sensed.time).plan, error

    def keep(flight: FlightMemory) -> tuple[burn_planning.BurnPlan, BurnError]:
        return flight.plan, state.burn_error

    with jax.named_scope("plan_burn"):
        # Outside of the branch, where the compiler finds that guidance works out the same.
        sight = target_pointing.point_at_target(params.flight.vehicle, flight.orbit, sensed.sky.sun_N)
        due = state.tick % scenario.formation_ticks == 0
        plan, error = jax.lax.cond(due, decide, keep, flight)
        return replace(flight, plan=plan), error


def guide(
    scenario: Scenario, params: Params, sensed: SensedTick, flight: FlightMemory, box_accepted: Flag
) -> tuple[FlightMemory, Array]:
    """Flight memory with the attitude reference of the tick, and the mode."""
    with jax.named_scope("guide"):
        return computer.guide(params.flight, flight, box_accepted, sensed.sky.sun_N, sensed.time, scenario.tick_s)


def make_telemetry(
    state: State, sensed: SensedTick, flight: FlightMemory, innovation: Innovation, mode: Array
) -> Telemetry:
    """What there is to see of the tick once guidance is done."""
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
    """Beginnings of the plant steps of a tick [s] after its own."""
    return jnp.arange(scenario.substeps, dtype=jnp.float64) * scenario.step_s


def initial_motion(state: State, decided: GuidedTick) -> Motion:
    """Motion before the first plant step of a tick."""
    return Motion(truth=state.truth, attitude=decided.flight.attitude, delta_v_N=jnp.zeros(3))


def wheel_torque_command(
    stages: Stages, params: Params, flight: FlightMemory, motion: Motion, offset: Scalar
) -> Vector:
    """Wheel torque commands [N m] `offset` [s] after the beginning of the tick."""
    now = replace(flight, attitude=motion.attitude)
    return computer.control_attitude(stages, params.flight, now, motion.truth.wheel_speed, offset)


def propagate_substep(
    scenario: Scenario,
    params: Params,
    state: State,
    decided: GuidedTick,
    motion: Motion,
    torque: Vector,
    offset: Scalar,
    gyro_normals: Vector,
) -> Motion:
    """Motion one plant step later, under constant wheel torques [N m]; `offset` [s] is that of the step in the tick."""
    dt, effects, plan, sensed = scenario.step_s, scenario.effects, decided.flight.plan, decided.sensed
    now = replace(decided.flight, attitude=motion.attitude)
    # Times since the step began: in single precision those since the start are too coarse to be told apart.
    ignition, cutoff = plan.ignition - sensed.time - offset, plan.cutoff - sensed.time - offset
    burn = ValveCommand(ignition=ignition, cutoff=cutoff, burn_error=decided.burn_error)
    delta_v_N = motion.delta_v_N + computer.expected_delta_v(params.flight, now, ignition, cutoff, dt)
    thrust = actuators.thrust_over_step(params.plant.thruster, burn, effects.integrator, effects.thruster_ramps, dt)
    truth = plant.step(effects, params.plant, motion.truth, torque, (thrust,), sensed.sky, sensed.health, dt)
    sample = gyro.measure(params.gyro, truth.omega_BN_B, state.sensor_errors.gyro_bias_B, gyro_normals, dt)
    attitude = attitude_ekf.integrate_gyro(motion.attitude, sample, dt)
    return Motion(truth=truth, attitude=attitude, delta_v_N=delta_v_N)


def control_and_propagate(
    stages: Stages, scenario: Scenario, params: Params, state: State, decided: GuidedTick
) -> Motion:
    """Motion at the end of the tick, under the flight software's own attitude control."""

    def step(motion: Motion, inputs: tuple[Array, Array]) -> tuple[Motion, None]:
        offset, gyro_normals = inputs
        torque = wheel_torque_command(stages, params, decided.flight, motion, offset)
        return propagate_substep(scenario, params, state, decided, motion, torque, offset, gyro_normals), None

    with jax.named_scope("act"):
        inputs = (substep_offsets(scenario), decided.sensed.noise.gyro)
        return jax.lax.scan(step, initial_motion(state, decided), inputs)[0]


def finish(
    stages: Stages, scenario: Scenario, params: Params, state: State, decided: GuidedTick, motion: Motion
) -> State:
    """State one tick later: both filters carried to the end of the tick, sensor errors too, and the run checked."""
    sensed, flight, burn_error = decided.sensed, decided.flight, decided.burn_error
    with jax.named_scope("act"):
        moved = replace(flight, attitude=motion.attitude)
        ratio = jnp.ones_like(sensed.time)
        if scenario.effects.faults:
            ratio = _measure_chamber_pressure(params, sensed.noise, burn_error, sensed.health)
        pull_N = _luni_solar_acceleration(scenario, flight, sensed.sky)
        after_flight = computer.predict(
            stages,
            params.flight,
            scenario.navigation_zonal_degree,
            moved,
            flight.attitude.q_BN,
            motion.delta_v_N,
            ratio,
            pull_N,
            sensed.time + scenario.tick_s,
            scenario.tick_s,
        )
        sensors = _advance_sensor_errors(scenario, params, state, sensed.noise)
    after = replace(state, truth=motion.truth, flight=after_flight, sensor_errors=sensors, burn_error=burn_error)
    with jax.named_scope("check"):
        after = _freeze_if_failed(params, state, after, sensed.time)
    return replace(after, tick=state.tick + 1)


def _measure(
    scenario: Scenario, params: Params, state: State, drawn: TickNoise, sky: SunMoonPositions, health: Health
) -> tuple[Measurements, CameraFrame]:
    truth = state.truth
    frame = camera_models.expose(
        scenario,
        params,
        truth,
        state.flight,
        state.sensor_errors.box_edge_errors,
        sky,
        health,
        drawn,
        noise.camera_key(state.keys, state.tick),
        state.tick,
    )
    measurements = Measurements(
        gps=_measure_gps(params, state, drawn, health),
        star_tracker_q_BN=star_tracker.measure(params.star_tracker, truth.q_BN, drawn.star_tracker),
        star_tracker_present=health.star_tracker
        & star_tracker.is_available(params.star_tracker, truth.q_BN, sky.sun_N),
        box=camera_models.box_measurement(scenario, params, frame),
    )
    return measurements, frame


def _measure_gps(params: Params, state: State, drawn: TickNoise, health: Health) -> GpsMeasurement:
    truth, bias_N = state.truth, state.sensor_errors.gps_bias_N
    if truth.orbit_low is None:
        position_N, residue_N = gps.measure(params.gps, truth.r_TN_N + truth.r_ST_N, bias_N, drawn.gps), None
    else:
        from_target_N = gps.measure(params.gps, truth.r_ST_N, bias_N, drawn.gps)
        position_N, residue_N = double_single.add(truth.r_TN_N, truth.orbit_low[0], from_target_N)
    return GpsMeasurement(position_N=position_N, position_low_N=residue_N, present=health.gps)


def _luni_solar_acceleration(scenario: Scenario, flight: FlightMemory, sky: SunMoonPositions) -> Array:
    """Pull [m/s^2] of Sun and Moon on the servicer, as flight software works it out from its almanac."""
    r = Difference(value=flight.orbit.servicer.r_SN_N, change=jnp.zeros(3))
    pull = jnp.zeros(3)
    if scenario.navigation_luni_solar:
        for mu, body_N in ((MU_SUN, sky.sun_N), (MU_MOON, sky.moon_N)):
            pull = pull + orbital_mechanics.third_body_acceleration(mu, body_N, r).value
    return pull


def _measure_chamber_pressure(params: Params, drawn: TickNoise, burn_error: BurnError, health: Health) -> Scalar:
    thrust = params.plant.thruster.force_scale * (1.0 + burn_error.magnitude) * health.thrust_fraction
    return chamber_pressure.measure(thrust, drawn.chamber_pressure)


def _advance_sensor_errors(scenario: Scenario, params: Params, state: State, drawn: TickNoise) -> SensorErrors:
    box_edges = state.sensor_errors.box_edge_errors
    if box_edges is not None:
        assert params.statistics is not None
        assert drawn.box_edge_errors is not None
        turned = safe.norm(state.truth.omega_TN_T) * scenario.tick_s
        box_edges = statistical_camera.advance_correlated_error(
            params.statistics, box_edges, turned, drawn.box_edge_errors
        )
    return SensorErrors(
        gps_bias_N=gps.advance_bias(params.gps, state.sensor_errors.gps_bias_N, drawn.biases[:3], scenario.tick_s),
        gyro_bias_B=gyro.advance_bias(params.gyro, state.sensor_errors.gyro_bias_B, drawn.biases[3:], scenario.tick_s),
        box_edge_errors=box_edges,
    )


def _finiteness_witnesses(state: State) -> tuple[object, ...]:
    """Numbers that show whether all of a state's are finite.

    Of covariances the traces, which anything else there enters within the next update and prediction.
    """
    flight = state.flight
    estimates = (flight.orbit.servicer, flight.orbit.relative, flight.attitude)
    traces = [sum(each.covariance[i, i] for i in range(each.covariance.shape[0])) for each in estimates]
    return state.truth, *(replace(each, covariance=trace) for each, trace in zip(estimates, traces, strict=True))


def _freeze_if_failed(params: Params, before: State, after: State, time: Scalar) -> State:
    """The new state, or the old one for a run that has failed now or earlier."""
    finite = safe.is_finite(_finiteness_witnesses(after))
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
