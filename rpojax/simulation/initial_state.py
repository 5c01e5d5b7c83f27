"""Initial state of a run: truth, and the orbit estimate with its hand-over error."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import random_streams
from rpojax.core.filter_state_layout import MOTION
from rpojax.core.frames import hill_frame
from rpojax.core.orbits.sun_moon_ephemeris import sun_and_moon_at
from rpojax.core.pytree import replace
from rpojax.core.random_streams import Stream
from rpojax.flight import computer
from rpojax.flight.decisions.mission_decision import TeamStart
from rpojax.flight.guidance import target_pointing
from rpojax.flight.navigation import combined_orbit_filter, relative_filter_state, servicer_orbit_ekf
from rpojax.flight.navigation.relative_filter_state import SLOW_STATES, VIEW_STATES
from rpojax.flight.stages import Stages
from rpojax.physics import equipment_faults, plant_state
from rpojax.physics.plant_state import Truth
from rpojax.physics.thruster import BurnError
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors import gyro, measurement_delay, star_tracker
from rpojax.simulation import command_delay, tick_measurements
from rpojax.simulation.noise import InitialNoise, draw_initial_noise, draw_tick_noise
from rpojax.simulation.state import SensorErrors, State
from rpojax.simulation.tick import Loop

Scalar = Float[Array, ""]


def random_keys(key: Array) -> Array:
    """Random keys (streams, 2) of a run, one for each stream, from that of the run."""
    return jax.vmap(lambda stream: random_streams.fold_in(key, stream))(jnp.arange(len(Stream) + 1))


def init(
    scenario: Scenario,
    params: Params,
    key: Array,
    noise: InitialNoise | None = None,
    first_decision: Scalar | None = None,
    stages: Stages | None = None,
) -> State:
    """Truth from the parameters, and an orbit estimate with hand-over errors.

    These have the covariance that the filter is told, unless the scenario has another one for the truth.

    Args:
        scenario: static settings
        params: parameters of the run
        key: random key of the run
        noise: random numbers, by default those of the key
        first_decision: () when the mission's first phase begins [s], by default at once
        stages: replaceable stages of the flight software, by default its own
    """
    streams, start = random_keys(key), params.initial
    noise = noise or draw_initial_noise(scenario, streams)
    identity = jnp.array([1.0, 0.0, 0.0, 0.0], dtype=start.relative_position.dtype)
    truth = plant_state.initial_truth(
        params.plant, params.orbit, start.relative_position, start.relative_velocity, identity
    )
    sensors = _sensor_errors(params, noise)
    error = _handover_error(params, truth, noise.handover)
    orbit = combined_orbit_filter.initial(
        params.flight.navigation,
        truth.r_TN_N + truth.r_ST_N + error[0:3],
        truth.v_TN_N + truth.v_ST_N + error[3:6],
        -truth.r_ST_N + error[6:9],
        -truth.v_ST_N + error[9:12],
        relative_filter_state.states_with(
            scenario.shown_states,
            VIEW_STATES if _shares(scenario) else SLOW_STATES,
        ),
        params.flight.target,
    )
    q_BN, omega = target_pointing.look_attitude(params.flight.vehicle, orbit)
    truth = replace(truth, q_BN=q_BN, omega_BN_B=omega)
    star_q = star_tracker.measure(params.star_tracker, q_BN, noise.star_tracker)
    gyro_B = gyro.measure(params.gyro, omega, sensors.gyro_bias_B, noise.gyro, scenario.step_s)
    loop, team = Loop(scenario, params, stages or Stages()), None
    if first_decision is not None:
        team = TeamStart(first_decision=first_decision, phase_rate=params.team.phase_rate)
    state = State(
        truth=truth,
        flight=computer.initial(loop.software, orbit, star_q, gyro_B, team),
        sensor_errors=sensors,
        burn_error=BurnError(magnitude=jnp.zeros_like(q_BN[0]), direction=jnp.zeros(3)),
        keys=streams,
        tick=jnp.zeros((), dtype=jnp.int32),
        failed_at=jnp.full_like(q_BN[0], jnp.inf),
        failure=jnp.zeros((), dtype=jnp.int32),
    )
    return _with_nothing_under_way(loop, state)


def _with_nothing_under_way(loop: Loop, state: State) -> State:
    """State with empty slots for late commands, and for the late measurements of each sensor."""
    scenario, delays, zero = loop.scenario, loop.scenario.delays, jnp.zeros_like(state.failed_at)
    if scenario.command_steps:
        state = replace(state, commands=command_delay.none_under_way(scenario.command_steps, scenario.thrusters, zero))
    if delays is None:
        return state

    def exposed() -> dict[str, Any]:
        noise, sky = draw_tick_noise(scenario, state.keys, state.tick), sun_and_moon_at(loop.params.epoch, zero)
        return tick_measurements.expose(loop, state, noise, sky, equipment_faults.healthy(), zero)

    # Only their shapes are wanted.
    shapes = jax.eval_shape(exposed)
    empty = {name: measurement_delay.none_in_transit(delays.slots, shapes[name], zero) for name in delays.sensors}
    return replace(state, in_transit=empty)


def _shares(scenario: Scenario) -> bool:
    """Whether the servicers of a team share boxes or estimates, with filters that have no state for burns."""
    return scenario.team is not None and scenario.team.link.sharing != "none"


def _sensor_errors(params: Params, noise: InitialNoise) -> SensorErrors:
    """Slowly varying errors of the sensors."""
    return SensorErrors(
        gps_bias_N=params.gps.bias_sigma * noise.biases[:3],
        gyro_bias_B=params.gyro.initial_bias_sigma * noise.biases[3:],
        box_edge_errors=noise.box_edge_errors,
        landmark_errors=noise.landmark_errors,
    )


def _handover_error(params: Params, truth: Truth, normals: Float[Array, "12"]) -> Float[Array, "12"]:
    """Errors in N of the servicer's position and velocity and of those of the target from it, from normal numbers."""
    navigation, handover = params.flight.navigation, params.handover
    told = [
        servicer_orbit_ekf.initial_sigma(navigation)[: MOTION.size],
        relative_filter_state.initial_sigma(navigation),
    ]
    told_error = jnp.concatenate(told) * normals
    if handover is None:
        return told_error
    R_HN, _ = hill_frame(truth.r_TN_N, truth.v_TN_N)

    def to_inertial(vector_H: Array) -> Array:
        return jnp.sum(R_HN * vector_H[:, None], axis=0)

    # The filter has the target from the servicer, the scenario the servicer from the target.
    sign = jnp.repeat(jnp.array([1.0, -1.0]), 6)
    if handover.covariance_factor is not None:
        error_H = jnp.sum(handover.covariance_factor * (sign * normals)[None, :], axis=1).reshape(4, 3)
        return sign * jnp.concatenate([to_inertial(part) for part in error_H])
    sigmas = (
        handover.position_sigma,
        handover.velocity_sigma,
        handover.relative_position_sigma,
        handover.relative_velocity_sigma,
    )
    parts = []
    for index, sigma in enumerate(sigmas):
        rows = slice(3 * index, 3 * index + 3)
        if sigma is None:
            parts.append(told_error[rows])
        elif sigma.ndim == 0:
            # Equal in all directions, so that no rotation rounds what is equal to the told sigma.
            parts.append(sigma * normals[rows])
        else:
            parts.append(to_inertial(sigma * normals[rows]))
    return jnp.concatenate(parts)
