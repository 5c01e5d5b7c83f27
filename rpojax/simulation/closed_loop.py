"""One closed-loop run: initial state, one tick, a rollout of many. Pure functions of one run; campaigns batch them."""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from rpojax.core import random_streams
from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.pytree import replace
from rpojax.core.random_streams import Stream
from rpojax.flight import computer
from rpojax.flight.computer import Stages
from rpojax.flight.guidance import target_pointing
from rpojax.flight.navigation import orbit_filter, relative_orbit_ekf, servicer_orbit_ekf
from rpojax.physics import plant
from rpojax.physics.actuators import BurnError
from rpojax.physics.plant import Truth
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.sensors import gyro, star_tracker
from rpojax.simulation import noise, step_stages
from rpojax.simulation.noise import InitialNoise, TickNoise
from rpojax.simulation.state import SensorErrors, State, Telemetry
from rpojax.simulation.step_stages import GuidedTick, sky_at

FAILURE_REASONS = ("", "non-finite state", "entered the keep-out sphere")
"""Reasons by failure code."""


def run_key(seed: int, run_id: int | Array) -> Array:
    """Random key of one run of a campaign."""
    return random_streams.fold_in(random_streams.master_key(seed), run_id)


def init(scenario: Scenario, params: Params, key: Array, drawn: InitialNoise | None = None) -> State:
    """State at the start: truth as given, flight software from the hand-over with errors drawn from its covariance.

    The run's own random numbers are used unless others are given.
    """
    streams = jax.vmap(lambda stream: random_streams.fold_in(key, stream))(jnp.arange(len(Stream) + 1))
    drawn = drawn or noise.draw_initial_noise(scenario, streams)
    navigation = params.flight.navigation
    identity = jnp.array([1.0, 0.0, 0.0, 0.0], dtype=jnp.float64)
    truth = plant.initial_truth(
        params.plant, params.orbit, params.initial.relative_position, params.initial.relative_velocity, identity
    )
    sensors = SensorErrors(
        gps_bias_N=params.gps.bias_sigma * drawn.biases[:3],
        gyro_bias_B=params.gyro.initial_bias_sigma * drawn.biases[3:],
        box_edge_errors=drawn.box_edge_errors,
    )
    sigma = [servicer_orbit_ekf.initial_sigma(navigation)[:6], relative_orbit_ekf.initial_sigma(navigation)[:6]]
    error = jnp.concatenate(sigma) * drawn.handover
    orbit = orbit_filter.initial(
        navigation,
        truth.r_TN_N + truth.r_ST_N + error[0:3],
        truth.v_TN_N + truth.v_ST_N + error[3:6],
        -truth.r_ST_N + error[6:9],
        -truth.v_ST_N + error[9:12],
    )
    q_BN, omega = target_pointing.look_attitude(params.flight.vehicle, orbit)
    truth = replace(truth, q_BN=q_BN, omega_BN_B=omega)
    star_q = star_tracker.measure(params.star_tracker, q_BN, drawn.star_tracker)
    gyro_B = gyro.measure(params.gyro, omega, sensors.gyro_bias_B, drawn.gyro, scenario.step_s)
    zero = jnp.zeros((), dtype=jnp.float64)
    return State(
        truth=truth,
        flight=computer.initial(params.flight, scenario.formation_period_s, orbit, star_q, gyro_B),
        sensor_errors=sensors,
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
    sensed = step_stages.sense(scenario, params, state, drawn)
    flight, innovation = step_stages.navigate(stages, scenario, params, state, sensed)
    flight, burn_error = step_stages.plan_burn(stages, scenario, params, state, sensed, flight)
    flight, mode = step_stages.guide(scenario, params, sensed, flight, innovation.accepted)
    telemetry = step_stages.make_telemetry(state, sensed, flight, innovation, mode)
    decided = GuidedTick(sensed=sensed, flight=flight, burn_error=burn_error)
    motion = step_stages.control_and_propagate(stages, scenario, params, state, decided)
    return step_stages.finish(stages, scenario, params, state, decided, motion), telemetry


def rollout(
    scenario: Scenario, params: Params, state: State, ticks: int, stages: Stages | None = None
) -> tuple[State, Telemetry]:
    """State after `ticks` ticks and their telemetry, time first."""
    chosen = stages or Stages()

    def body(carry: State, _: None) -> tuple[State, Telemetry]:
        return tick(chosen, scenario, params, carry)

    return jax.lax.scan(body, state, None, length=ticks)


def true_relative_state(truth: Truth) -> tuple[Array, Array]:
    """True `rho_H` [m] and `rho_dot_H` [m/s]."""
    R_HN, omega_HN_N = hill_frame(truth.r_TN_N, truth.v_TN_N)
    return inertial_to_hill(truth.r_ST_N, truth.v_ST_N, R_HN, omega_HN_N)


__all__ = [
    "FAILURE_REASONS",
    "State",
    "Telemetry",
    "init",
    "rollout",
    "run_key",
    "sky_at",
    "tick",
    "true_relative_state",
]
