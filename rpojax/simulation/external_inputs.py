"""Inputs of an external program to a tick of live co-simulation: orbit estimate, burns, and what it needs to command.

The tick itself runs through the same stages as `step.step`.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, UInt8

from rpojax.core.pytree import pytree, replace, select
from rpojax.flight.control.attitude_control import AttitudeCommand
from rpojax.flight.guidance import burn_schedule, slew_profile, target_pointing
from rpojax.flight.guidance.burn_schedule import ExternalBurn
from rpojax.physics.thruster import draw_burn_error
from rpojax.simulation import camera_models, noise, step_stages
from rpojax.simulation.tick import Loop, Tick


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


def replace_orbit_estimate(tick: Tick, estimate: ExternalOrbitEstimate) -> Tick:
    """The tick after navigation with an external orbit estimate; other filter states stay, uncorrelated with it."""
    servicer, relative = tick.flight.orbit.servicer, tick.flight.orbit.relative
    orbit = replace(
        tick.flight.orbit,
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
    return replace(tick, flight=replace(tick.flight, orbit=orbit))


def _with_orbit_block(P: Float[Array, "n n"], block: Float[Array, "6 6"]) -> Float[Array, "n n"]:
    zero = jnp.zeros((6, P.shape[0] - 6), dtype=P.dtype)
    top = jnp.concatenate([block, zero], axis=1)
    return jnp.concatenate([top, jnp.concatenate([zero.T, P[6:, 6:]], axis=1)], axis=0)


def plan_external_burn(loop: Loop, tick: Tick, burn: ExternalBurn) -> Tick:
    """The tick with a burn plan from an external command, in place of the stage `plan_burn`."""
    guidance, flight, before = loop.software.guidance, tick.flight, tick.flight.plan
    q_look, _ = target_pointing.look_attitude(guidance.vehicle, flight.orbit, flight.pointing.reference.q_EN)
    plan = burn_schedule.plan_from_command(guidance, burn, before, q_look, tick.time)
    # Each ignition has its own execution error; a change of the cutoff alone keeps it.
    is_new = burn.commanded & (burn.cutoff > burn.ignition) & (burn.ignition != before.ignition)
    burn_error = draw_burn_error(loop.params.plant.thruster, tick.noise.burn)
    return replace(
        tick,
        flight=replace(flight, plan=plan),
        burn_error=select(is_new, burn_error, tick.burn_error),
    )


def attitude_commands(loop: Loop, tick: Tick) -> AttitudeCommand:
    """Attitude commands of a tick after guidance, one for every plant step."""
    offsets = step_stages.substep_offsets(loop.scenario)
    return jax.vmap(lambda offset: slew_profile.evaluate(tick.flight.pointing.reference, offset))(offsets)


def detector_picture(loop: Loop, tick: Tick) -> UInt8[Array, "p p 3"]:
    """Detector input of a rendered camera as 8-bit sRGB codes."""
    state = tick.state
    params = loop.params.seen_through(state.flight.lens)
    window = camera_models.recorded_window(loop.scenario, params, tick.frame.window)
    key = noise.camera_key(state.keys, state.tick)
    picture = camera_models.render_picture(loop.scenario, params, window, state.truth, tick.sky, key, state.tick)
    return jnp.round(255.0 * picture).astype(jnp.uint8)
