"""Stages of a tick compiled one by one, some of which an external program may replace (co-simulation).

One tick is `sense_and_navigate`, `plan_burn_and_guide`, `step_stages.initial_motion`, then `propagate_substep` for
every plant step or `control_and_propagate`, then `finish`. Without external inputs the run equals that of `rollout` up
to rounding.
"""

from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, UInt8

from rpojax.core.pytree import pytree, replace, select
from rpojax.flight.computer import FlightMemory, Stages
from rpojax.flight.control.attitude_control import AttitudeCommand
from rpojax.flight.guidance import burn_planning, slew_profile
from rpojax.flight.navigation.combined_orbit_filter import Innovation
from rpojax.physics.thruster import BurnError, draw_burn_error
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import camera_models, noise, step_stages
from rpojax.simulation.state import State
from rpojax.simulation.step_stages import GuidedTick, Motion, SensedTick
from rpojax.simulation.telemetry import Telemetry

BurnDecider = Literal["flight_software", "external", "none"]
"""Source of the burn plan: flight software, an external burn in this tick, or none, which keeps the plan."""


@pytree
class ExternalOrbitEstimate:
    """Orbit estimate of an external navigation filter.

    Attributes:
        r_SN_N: (3,) servicer [m]
        v_SN_N: (3,) [m/s]
        r_TS_N: (3,) target from servicer [m]
        v_TS_N: (3,) its inertial derivative [m/s]
        servicer_covariance: (6, 6) of the servicer [m, m/s]
        relative_covariance: (6, 6) of the target relative to the servicer [m, m/s]
    """

    r_SN_N: Array
    v_SN_N: Array
    r_TS_N: Array
    v_TS_N: Array
    servicer_covariance: Array
    relative_covariance: Array


@pytree
class ExternalBurn:
    """Burn commanded by an external program; times since the start of the run.

    Attributes:
        ignition: () [s]
        cutoff: () [s]; the valve closes immediately if it is not later than the ignition
        q_burn: (4,) body attitude during the burn
    """

    ignition: Array
    cutoff: Array
    q_burn: Array


@pytree
class NavigatedTick:
    """A tick after sensing and navigation."""

    sensed: SensedTick
    flight: FlightMemory
    innovation: Innovation


@partial(jax.jit, static_argnums=(0, 1))
def sense_and_navigate(stages: Stages, scenario: Scenario, params: Params, state: State) -> NavigatedTick:
    """Sensing and measurement updates of a tick."""
    sensed = step_stages.sense(scenario, params, state)
    flight, innovation = step_stages.navigate(stages, scenario, params, state, sensed)
    return NavigatedTick(sensed=sensed, flight=flight, innovation=innovation)


@jax.jit
def replace_orbit_estimate(navigated: NavigatedTick, estimate: ExternalOrbitEstimate) -> NavigatedTick:
    """The tick with an external orbit estimate; other filter states stay, uncorrelated with it."""
    servicer, relative = navigated.flight.orbit.servicer, navigated.flight.orbit.relative
    orbit = replace(
        navigated.flight.orbit,
        servicer=replace(
            servicer,
            r_SN_N=estimate.r_SN_N,
            v_SN_N=estimate.v_SN_N,
            covariance=_with_orbit_block(servicer.covariance, estimate.servicer_covariance),
        ),
        relative=replace(
            relative,
            r_TS_N=estimate.r_TS_N,
            v_TS_N=estimate.v_TS_N,
            covariance=_with_orbit_block(relative.covariance, estimate.relative_covariance),
        ),
    )
    return replace(navigated, flight=replace(navigated.flight, orbit=orbit))


def _with_orbit_block(P: Float[Array, "n n"], block: Float[Array, "6 6"]) -> Float[Array, "n n"]:
    zero = jnp.zeros((6, P.shape[0] - 6), dtype=P.dtype)
    top = jnp.concatenate([block, zero], axis=1)
    return jnp.concatenate([top, jnp.concatenate([zero.T, P[6:, 6:]], axis=1)], axis=0)


@partial(jax.jit, static_argnums=(0, 1, 2))
def plan_burn_and_guide(
    stages: Stages,
    scenario: Scenario,
    decider: BurnDecider,
    params: Params,
    state: State,
    navigated: NavigatedTick,
    burn: ExternalBurn,
) -> tuple[GuidedTick, Telemetry]:
    """Burn plan and attitude reference of the tick, and its telemetry; `burn` counts only for an external decider."""
    sensed, flight, burn_error = navigated.sensed, navigated.flight, state.burn_error
    if decider == "flight_software":
        flight, burn_error = step_stages.plan_burn(stages, scenario, params, state, sensed, flight)
    elif decider == "external":
        flight, burn_error = _plan_external_burn(params, state, sensed, flight, burn)
    flight, mode = step_stages.guide(scenario, params, sensed, flight, navigated.innovation.accepted)
    telemetry = step_stages.make_telemetry(state, sensed, flight, navigated.innovation, mode)
    return GuidedTick(sensed=sensed, flight=flight, burn_error=burn_error), telemetry


def _plan_external_burn(
    params: Params, state: State, sensed: SensedTick, flight: FlightMemory, burn: ExternalBurn
) -> tuple[FlightMemory, BurnError]:
    plan = burn_planning.plan_from_command(
        params.flight.pointing,
        params.flight.vehicle,
        flight.orbit,
        flight.plan,
        burn.ignition,
        burn.cutoff,
        burn.q_burn,
        sensed.time,
    )
    # Each ignition has its own execution error; a change of the cutoff alone keeps it.
    burn_error = draw_burn_error(params.plant.thruster, sensed.noise.burn)
    new = (burn.cutoff > burn.ignition) & (burn.ignition != flight.plan.ignition)
    return replace(flight, plan=plan), select(new, burn_error, state.burn_error)


@partial(jax.jit, static_argnums=0)
def attitude_commands(scenario: Scenario, guided: GuidedTick) -> AttitudeCommand:
    """Attitude commands of a tick, one for every plant step."""
    offsets = step_stages.substep_offsets(scenario)
    return jax.vmap(lambda offset: slew_profile.evaluate(guided.flight.pointing.reference, offset))(offsets)


@partial(jax.jit, static_argnums=0)
def propagate_substep(
    scenario: Scenario,
    params: Params,
    state: State,
    guided: GuidedTick,
    motion: Motion,
    torque: Float[Array, "3"],
    step: Int[Array, ""],
) -> Motion:
    """State of the vehicle after plant step number `step` of the tick, under external wheel torques [N m]."""
    offset, gyro_normals = step_stages.substep_offsets(scenario)[step], guided.sensed.noise.gyro[step]
    return step_stages.propagate_substep(scenario, params, state, guided, motion, torque, offset, gyro_normals)


@partial(jax.jit, static_argnums=(0, 1))
def control_and_propagate(
    stages: Stages, scenario: Scenario, params: Params, state: State, guided: GuidedTick
) -> Motion:
    """State of the vehicle at the end of the tick, under the attitude control of the flight software."""
    return step_stages.control_and_propagate(stages, scenario, params, state, guided)


@partial(jax.jit, static_argnums=(0, 1))
def finish(
    stages: Stages, scenario: Scenario, params: Params, state: State, guided: GuidedTick, motion: Motion
) -> State:
    """State at the beginning of the next tick."""
    return step_stages.finish(stages, scenario, params, state, guided, motion)


@partial(jax.jit, static_argnums=0)
def detector_picture(
    scenario: Scenario, params: Params, state: State, window_px: Float[Array, "3"]
) -> UInt8[Array, "p p 3"]:
    """Detector input of a rendered camera as 8-bit sRGB codes, for a recorded window."""
    sky = step_stages.sun_and_moon_at(scenario, state.tick.astype(jnp.float64) * scenario.tick_s)
    window = camera_models.recorded_window(scenario, params, window_px)
    key = noise.camera_key(state.keys, state.tick)
    picture = camera_models.render_picture(scenario, params, window, state.truth, sky, key, state.tick)
    return jnp.round(255.0 * picture).astype(jnp.uint8)
