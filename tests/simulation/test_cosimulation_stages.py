"""Stages of a tick one by one, with burns, torques and estimates of an external program."""

import jax
import jax.numpy as jnp
import numpy as np
from short_run import STAGES, TICKS, Run, assert_close

from rpojax.core.pytree import replace
from rpojax.flight.control import attitude_control
from rpojax.flight.control.attitude_control import AttitudeCommand
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import cosimulation_stages, step_stages
from rpojax.simulation.cosimulation_stages import ExternalBurn
from rpojax.simulation.state import State
from rpojax.simulation.step_stages import GuidedTick, Motion

NO_BURN = ExternalBurn(ignition=jnp.zeros(()), cutoff=jnp.zeros(()), q_burn=jnp.array([1.0, 0.0, 0.0, 0.0]))


def test_the_stages_one_by_one_equal_the_rollout(loop: tuple[Scenario, Params], start: State, run: Run) -> None:
    scenario, params = loop
    state, telemetries = start, []
    for _ in range(TICKS):
        navigated = cosimulation_stages.sense_and_navigate(STAGES, scenario, params, state)
        guided, telemetry = cosimulation_stages.plan_burn_and_guide(
            STAGES, scenario, "flight_software", params, state, navigated, NO_BURN
        )
        motion = cosimulation_stages.control_and_propagate(STAGES, scenario, params, state, guided)
        state = cosimulation_stages.finish(STAGES, scenario, params, state, guided, motion)
        telemetries.append(telemetry)
    assert_close(state, run[0])
    assert_close(jax.tree.map(lambda *leaves: jnp.stack(leaves), *telemetries), run[1])


def test_external_burns_and_torques_equal_to_those_of_the_flight_software_give_the_same_run(
    loop: tuple[Scenario, Params], start: State, run: Run
) -> None:
    scenario, params = loop
    plans = run[1].flight.plan
    state, accelerations = start, []
    for tick in range(TICKS):
        # The command is repeated in every tick.
        burn = ExternalBurn(ignition=plans.ignition[tick], cutoff=plans.cutoff[tick], q_burn=plans.q_burn[tick])
        navigated = cosimulation_stages.sense_and_navigate(STAGES, scenario, params, state)
        guided, _ = cosimulation_stages.plan_burn_and_guide(
            STAGES, scenario, "external", params, state, navigated, burn
        )
        motion = step_stages.initial_motion(state, guided)
        commands = cosimulation_stages.attitude_commands(scenario, guided)
        accelerations.append(float(jnp.max(jnp.abs(commands.acceleration_C))))
        for substep in range(scenario.substeps):
            command = jax.tree.map(lambda values, substep=substep: values[substep], commands)
            torque = wheel_torque(params, guided, motion, command)
            motion = cosimulation_stages.propagate_substep(
                scenario, params, state, guided, motion, torque, jnp.array(substep)
            )
        state = cosimulation_stages.finish(STAGES, scenario, params, state, guided, motion)
    assert max(accelerations) > 0.01  # the reference contains a slew
    assert_close(state, run[0])


@jax.jit
def wheel_torque(params: Params, guided: GuidedTick, motion: Motion, command: AttitudeCommand) -> jax.Array:
    """Wheel torques of the packaged controller."""
    flight = params.flight
    return attitude_control.wheel_torque(
        flight.attitude_control,
        flight.vehicle,
        guided.flight.wheel_allocation,
        motion.attitude,
        command,
        motion.truth.wheel_speed,
    )


def test_an_external_program_can_abort_a_burn(loop: tuple[Scenario, Params], start: State, run: Run) -> None:
    scenario, params = loop
    plan = jax.tree.map(lambda leaf: leaf[60], run[1].flight.plan)
    assert float(plan.ignition) < 60.0 < float(plan.cutoff) - 1.0
    state = replace(start, tick=jnp.array(60, dtype=jnp.int32), flight=replace(start.flight, plan=plan))
    navigated = cosimulation_stages.sense_and_navigate(STAGES, scenario, params, state)
    guided, _ = cosimulation_stages.plan_burn_and_guide(STAGES, scenario, "external", params, state, navigated, NO_BURN)
    aborted = guided.flight.plan
    np.testing.assert_array_equal([aborted.ignition, aborted.cutoff], [plan.ignition, 60.0])
    np.testing.assert_array_equal(guided.burn_error.magnitude, start.burn_error.magnitude)


def test_an_external_orbit_estimate_replaces_that_of_the_filter(loop: tuple[Scenario, Params], start: State) -> None:
    navigated = cosimulation_stages.sense_and_navigate(STAGES, *loop, start)
    servicer, relative = navigated.flight.orbit.servicer, navigated.flight.orbit.relative
    estimate = cosimulation_stages.ExternalOrbitEstimate(
        r_SN_N=servicer.r_SN_N + 1.0,
        v_SN_N=servicer.v_SN_N,
        r_TS_N=relative.r_TS_N,
        v_TS_N=relative.v_TS_N - 0.5,
        servicer_covariance=2.0 * servicer.covariance[:6, :6],
        relative_covariance=jnp.eye(6),
    )
    after = cosimulation_stages.replace_orbit_estimate(navigated, estimate).flight.orbit
    np.testing.assert_array_equal(after.servicer.r_SN_N, servicer.r_SN_N + 1.0)
    np.testing.assert_array_equal(after.relative.v_TS_N, relative.v_TS_N - 0.5)
    np.testing.assert_array_equal(after.servicer.covariance[:6, :6], 2.0 * servicer.covariance[:6, :6])
    np.testing.assert_array_equal(after.servicer.covariance[6:, 6:], servicer.covariance[6:, 6:])
    np.testing.assert_array_equal(after.relative.covariance[:6, :6], np.eye(6))
    assert not np.any(after.relative.covariance[:6, 6:])
    assert np.all(np.linalg.eigvalsh(after.relative.covariance) > 0.0)
