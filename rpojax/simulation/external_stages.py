"""A run stepped from outside, stage by stage, so that somebody else may do the work of some of them.

One tick is `begin`, `decide`, `tick_stages.set_off`, then `move` for every plant step, or `move_all`, then `finish`.
With nothing given from outside, the run is that of `closed_loop.rollout`, to rounding.
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
from rpojax.flight.navigation.orbit_filter import Innovation
from rpojax.physics import actuators
from rpojax.physics.actuators import BurnError
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.simulation import camera_models, noise, step_stages
from rpojax.simulation.state import State, Telemetry
from rpojax.simulation.step_stages import GuidedTick, Motion, SensedTick

BurnDecider = Literal["own", "given", "nobody"]
"""Who decides on burns: flight software, somebody else now, or nobody, so that the plan stays as it is."""


@pytree
class ExternalOrbitEstimate:
    """An orbit estimate from outside.

    Attributes:
        r_SN_N: (3,) servicer [m]
        v_SN_N: (3,) [m/s]
        r_TS_N: (3,) target from servicer [m]
        v_TS_N: (3,) its inertial derivative [m/s]
        servicer_covariance: (6, 6) of the first two [m, m/s]
        relative_covariance: (6, 6) of the last two [m, m/s]
    """

    r_SN_N: Array
    v_SN_N: Array
    r_TS_N: Array
    v_TS_N: Array
    servicer_covariance: Array
    relative_covariance: Array


@pytree
class ExternalBurn:
    """A burn from outside; times count from the start of the run.

    Attributes:
        ignition: () [s]
        cutoff: () [s]; where it is not later than the ignition, the valve closes at once
        q_burn: (4,) attitude of the body meanwhile
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
    """Sensors, and the filters of the flight software."""
    sensed = step_stages.sense(scenario, params, state)
    flight, innovation = step_stages.navigate(stages, scenario, params, state, sensed)
    return NavigatedTick(sensed=sensed, flight=flight, innovation=innovation)


@jax.jit
def replace_orbit_estimate(begun: NavigatedTick, given: ExternalOrbitEstimate) -> NavigatedTick:
    """The tick with somebody else's orbit estimate; what else the filters know of stays, as if it were unrelated."""
    servicer, relative = begun.flight.orbit.servicer, begun.flight.orbit.relative
    orbit = replace(
        begun.flight.orbit,
        servicer=replace(
            servicer,
            r_SN_N=given.r_SN_N,
            v_SN_N=given.v_SN_N,
            covariance=_with_orbit_block(servicer.covariance, given.servicer_covariance),
        ),
        relative=replace(
            relative,
            r_TS_N=given.r_TS_N,
            v_TS_N=given.v_TS_N,
            covariance=_with_orbit_block(relative.covariance, given.relative_covariance),
        ),
    )
    return replace(begun, flight=replace(begun.flight, orbit=orbit))


def _with_orbit_block(P: Float[Array, "n n"], given: Float[Array, "6 6"]) -> Float[Array, "n n"]:
    zero = jnp.zeros((6, P.shape[0] - 6), dtype=P.dtype)
    top = jnp.concatenate([given, zero], axis=1)
    return jnp.concatenate([top, jnp.concatenate([zero.T, P[6:, 6:]], axis=1)], axis=0)


@partial(jax.jit, static_argnums=(0, 1, 2))
def plan_burn_and_guide(
    stages: Stages,
    scenario: Scenario,
    decider: BurnDecider,
    params: Params,
    state: State,
    begun: NavigatedTick,
    burn: ExternalBurn,
) -> tuple[GuidedTick, Telemetry]:
    """Burn and attitude reference of the tick, and what there is to see; `burn` counts only where it is `given`."""
    sensed, flight, burn_error = begun.sensed, begun.flight, state.burn_error
    if decider == "own":
        flight, burn_error = step_stages.plan_burn(stages, scenario, params, state, sensed, flight)
    elif decider == "given":
        flight, burn_error = _plan_external_burn(params, state, sensed, flight, burn)
    flight, mode = step_stages.guide(scenario, params, sensed, flight, begun.innovation.accepted)
    seen = step_stages.make_telemetry(state, sensed, flight, begun.innovation, mode)
    return GuidedTick(sensed=sensed, flight=flight, burn_error=burn_error), seen


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
    # Each ignition has an error of its own; whoever only closes the valve at another time keeps it.
    drawn = actuators.draw_burn_error(params.plant.thruster, sensed.noise.burn)
    new = (burn.cutoff > burn.ignition) & (burn.ignition != flight.plan.ignition)
    return replace(flight, plan=plan), select(new, drawn, state.burn_error)


@partial(jax.jit, static_argnums=0)
def attitude_commands(scenario: Scenario, decided: GuidedTick) -> AttitudeCommand:
    """Attitude commands of the tick, one for every plant step."""
    offsets = step_stages.substep_offsets(scenario)
    return jax.vmap(lambda offset: slew_profile.evaluate(decided.flight.pointing.reference, offset))(offsets)


@partial(jax.jit, static_argnums=0)
def propagate_substep(
    scenario: Scenario,
    params: Params,
    state: State,
    decided: GuidedTick,
    motion: Motion,
    torque: Float[Array, "3"],
    step: Int[Array, ""],
) -> Motion:
    """Motion after the plant step of that number in the tick, under given wheel torques [N m]."""
    offset, gyro_normals = step_stages.substep_offsets(scenario)[step], decided.sensed.noise.gyro[step]
    return step_stages.propagate_substep(scenario, params, state, decided, motion, torque, offset, gyro_normals)


@partial(jax.jit, static_argnums=(0, 1))
def control_and_propagate(
    stages: Stages, scenario: Scenario, params: Params, state: State, decided: GuidedTick
) -> Motion:
    """Motion at the end of the tick under the flight software's own attitude control."""
    return step_stages.control_and_propagate(stages, scenario, params, state, decided)


@partial(jax.jit, static_argnums=(0, 1))
def finish(
    stages: Stages, scenario: Scenario, params: Params, state: State, decided: GuidedTick, motion: Motion
) -> State:
    """State at the beginning of the next tick."""
    return step_stages.finish(stages, scenario, params, state, decided, motion)


@partial(jax.jit, static_argnums=0)
def detector_picture(
    scenario: Scenario, params: Params, state: State, window_px: Float[Array, "3"]
) -> UInt8[Array, "p p 3"]:
    """Codes of the picture that the detector of a rendered camera gets, of the window that the frame has recorded."""
    sky = step_stages.sky_at(scenario, state.tick.astype(jnp.float64) * scenario.tick_s)
    view = camera_models.recorded_window(scenario, params, window_px)
    key = noise.camera_key(state.keys, state.tick)
    taken = camera_models.render_picture(scenario, params, view, state.truth, sky, key, state.tick)
    return jnp.round(255.0 * taken).astype(jnp.uint8)
