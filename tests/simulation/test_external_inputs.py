"""Stages of a tick one by one, with burns, torques and estimates of an external program."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from short_run import STAGES, TICKS, Run, assert_close

from rpojax.core.pytree import replace
from rpojax.flight.control import attitude_control
from rpojax.flight.control.attitude_control import AttitudeCommand
from rpojax.flight.guidance.burn_schedule import ExternalBurn
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import external_inputs, step_stages
from rpojax.simulation.state import State
from rpojax.simulation.telemetry import Telemetry, telemetry_of
from rpojax.simulation.tick import Loop, Motion, Tick

CLOSED_VALVE = ExternalBurn(
    commanded=jnp.array(True), ignition=jnp.zeros(()), cutoff=jnp.zeros(()), q_burn=jnp.array([1.0, 0.0, 0.0, 0.0])
)
NO_COMMAND = replace(CLOSED_VALVE, commanded=jnp.array(False))


@partial(jax.jit, static_argnums=0)
def begin(scenario: Scenario, params: Params, state: State) -> Tick:
    """Sensing and navigation."""
    loop = Loop(scenario, params, STAGES)
    return step_stages.navigate(loop, step_stages.sense(loop, step_stages.command_camera(loop, state)))


@partial(jax.jit, static_argnums=0)
def own_tick(scenario: Scenario, params: Params, tick: Tick) -> tuple[State, Telemetry]:
    """The rest of a tick under the flight software."""
    loop = Loop(scenario, params, STAGES)
    guided = step_stages.guide(loop, step_stages.plan_burn(loop, tick))
    motion = step_stages.control_and_propagate(loop, guided)
    return step_stages.finish(loop, guided, motion), telemetry_of(loop, guided)


@partial(jax.jit, static_argnums=0)
def guide(scenario: Scenario, params: Params, tick: Tick, burn: ExternalBurn) -> tuple[Tick, AttitudeCommand]:
    """The tick after guidance with an external burn, and its attitude commands."""
    loop = Loop(scenario, params, STAGES)
    guided = step_stages.guide(loop, external_inputs.plan_external_burn(loop, tick, burn))
    return guided, external_inputs.attitude_commands(loop, guided)


@partial(jax.jit, static_argnums=0)
def plan_external_burn(scenario: Scenario, params: Params, tick: Tick, burn: ExternalBurn) -> Tick:
    """The tick with the plan of an external burn."""
    return external_inputs.plan_external_burn(Loop(scenario, params, STAGES), tick, burn)


@partial(jax.jit, static_argnums=0)
def plant_step(
    scenario: Scenario, params: Params, tick: Tick, motion: Motion, command: AttitudeCommand, number: int
) -> Motion:
    """A plant step under the torques of the packaged controller, computed as an external program does."""
    flight = params.flight
    torque = attitude_control.wheel_torque(
        flight.attitude_control,
        flight.vehicle,
        tick.flight.wheel_allocation,
        motion.attitude,
        command,
        motion.truth.wheel_speed,
    )
    offset = step_stages.substep_offsets(scenario)[number]
    loop = Loop(scenario, params, STAGES)
    return step_stages.propagate_substep(loop, tick, motion, torque, offset, tick.noise.gyro[number])


@partial(jax.jit, static_argnums=0)
def finish(scenario: Scenario, params: Params, tick: Tick, motion: Motion) -> State:
    """State at the beginning of the next tick."""
    return step_stages.finish(Loop(scenario, params, STAGES), tick, motion)


def test_the_stages_one_by_one_equal_the_rollout(loop: tuple[Scenario, Params], start: State, run: Run) -> None:
    state, telemetries = start, []
    for _ in range(TICKS):
        state, telemetry = own_tick(*loop, begin(*loop, state))
        telemetries.append(telemetry)
    assert_close(state, run[0])
    assert_close(jax.tree.map(lambda *leaves: np.stack(leaves), *telemetries), run[1])


def test_external_burns_and_torques_equal_to_those_of_the_flight_software_give_the_same_run(
    loop: tuple[Scenario, Params], start: State, run: Run
) -> None:
    scenario, _ = loop
    plans = run[1].flight.plan
    state, accelerations = start, []
    for number in range(TICKS):
        # The command is repeated in every tick.
        burn = replace(
            CLOSED_VALVE, ignition=plans.ignition[number], cutoff=plans.cutoff[number], q_burn=plans.q_burn[number]
        )
        tick, commands = guide(*loop, begin(*loop, state), burn)
        accelerations.append(float(jnp.max(jnp.abs(commands.acceleration_C))))
        motion = step_stages.initial_motion(tick)
        for substep in range(scenario.substeps):
            command = jax.tree.map(lambda values, substep=substep: values[substep], commands)
            motion = plant_step(*loop, tick, motion, command, substep)
        state = finish(*loop, tick, motion)
    assert max(accelerations) > 0.01  # the reference contains a slew
    assert_close(state, run[0])


def during_burn(start: State, run: Run) -> tuple[State, Any]:
    """State with a burn under way at 60 s, and its plan."""
    plan = jax.tree.map(lambda leaf: leaf[60], run[1].flight.plan)
    assert float(plan.ignition) < 60.0 < float(plan.cutoff) - 1.0
    return replace(start, tick=jnp.array(60, dtype=jnp.int32), flight=replace(start.flight, plan=plan)), plan


def test_an_external_program_can_abort_a_burn(loop: tuple[Scenario, Params], start: State, run: Run) -> None:
    state, plan = during_burn(start, run)
    tick, _ = guide(*loop, begin(*loop, state), CLOSED_VALVE)
    aborted = tick.flight.plan
    np.testing.assert_array_equal([aborted.ignition, aborted.cutoff], [plan.ignition, 60.0])
    np.testing.assert_array_equal(tick.burn_error.magnitude, start.burn_error.magnitude)


def test_without_a_command_the_plan_and_its_execution_error_stay(
    loop: tuple[Scenario, Params], start: State, run: Run
) -> None:
    state, plan = during_burn(start, run)
    navigated = begin(*loop, state)
    tick, _ = guide(*loop, navigated, replace(NO_COMMAND, ignition=jnp.array(70.0), cutoff=jnp.array(80.0)))
    before = plan_external_burn(*loop, navigated, NO_COMMAND)
    for name in ("ignition", "cutoff", "turn_start", "q_burn", "delta_v_N"):
        np.testing.assert_array_equal(getattr(before.flight.plan, name), getattr(plan, name))
    np.testing.assert_array_equal(tick.burn_error.magnitude, start.burn_error.magnitude)


def test_an_external_orbit_estimate_replaces_that_of_the_filter(loop: tuple[Scenario, Params], start: State) -> None:
    navigated = begin(*loop, start)
    before = jax.device_get(navigated.flight.orbit)
    servicer, relative = before.servicer, before.relative
    estimate = external_inputs.ExternalOrbitEstimate(
        r_SN_N=jnp.asarray(servicer.r_SN_N + 1.0),
        v_SN_N=jnp.asarray(servicer.v_SN_N),
        r_TS_N=jnp.asarray(relative.r_TS_N),
        v_TS_N=jnp.asarray(relative.v_TS_N - 0.5),
        servicer_covariance=jnp.asarray(2.0 * servicer.covariance[:6, :6]),
        relative_covariance=jnp.asarray(np.eye(6)),
    )
    after = jax.device_get(jax.jit(external_inputs.replace_orbit_estimate)(navigated, estimate).flight.orbit)
    np.testing.assert_array_equal(after.servicer.r_SN_N, servicer.r_SN_N + 1.0)
    np.testing.assert_array_equal(after.relative.v_TS_N, relative.v_TS_N - 0.5)
    np.testing.assert_array_equal(after.servicer.covariance[:6, :6], 2.0 * servicer.covariance[:6, :6])
    np.testing.assert_array_equal(after.servicer.covariance[6:, 6:], servicer.covariance[6:, 6:])
    np.testing.assert_array_equal(after.relative.covariance[:6, :6], np.eye(6))
    assert not np.any(after.relative.covariance[:6, 6:])
    assert np.all(np.linalg.eigvalsh(after.relative.covariance) > 0.0)
