"""One tick of the closed loop against the scan of many."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from short_run import STAGES, TICKS, Run, assert_close

from rpojax.flight.flight_records import FlightMemory
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.state import State
from rpojax.simulation.step import step
from rpojax.simulation.step_stages import finish, sense
from rpojax.simulation.tick import Loop, Motion

tick = jax.jit(step, static_argnums=(0, 3))


def test_telemetry_has_the_state_at_the_beginning_of_the_tick(run: Run, start: State) -> None:
    _, telemetry = run
    np.testing.assert_array_equal(telemetry.truth.r_ST_N[0], start.truth.r_ST_N)
    np.testing.assert_array_equal(telemetry.truth.q_BN[0], start.truth.q_BN)


@pytest.mark.slow
def test_a_loop_of_steps_equals_the_rollout(loop: tuple[Scenario, Params], start: State, run: Run) -> None:
    scenario, params = loop
    state, telemetries = start, []
    for _ in range(TICKS):
        state, telemetry = tick(scenario, params, state, STAGES)
        telemetries.append(telemetry)
    assert_close(state, run[0])
    assert_close(jax.tree.map(lambda *leaves: jnp.stack(leaves), *telemetries), run[1])


@partial(jax.jit, static_argnums=0)
def after_a_burn(scenario: Scenario, params: Params, state: State) -> tuple[FlightMemory, jax.Array]:
    """Memory after a tick with a burn, and the error of the chamber pressure in its 1 sigma."""
    loop = Loop(scenario, params, STAGES)
    tick = sense(loop, state)
    motion = Motion(truth=state.truth, attitude=state.flight.attitude, delta_v_N=jnp.array([1e-3, 0.0, 0.0]))
    return finish(loop, tick, motion).flight, tick.noise.chamber_pressure


def test_the_chamber_pressure_is_measured_by_its_own_switch_and_not_by_that_of_faults(
    loop: tuple[Scenario, Params], start: State
) -> None:
    scenario, params = loop
    faulty = replace(scenario, effects=replace(scenario.effects, faults=True))
    plain, _ = after_a_burn(scenario, params, start)
    without_a_fault, _ = after_a_burn(faulty, params, start)
    jax.tree.map(np.testing.assert_array_equal, without_a_fault, plain)
    measuring, normal = after_a_burn(replace(scenario, chamber_pressure=True), params, start)
    prior, noise = 0.02**2 + 0.01**2 * scenario.tick_s, 0.03**2
    expected = 1.0 + prior / (prior + noise) * (float(params.plant.thruster.force_scale) * (1.0 + 0.03 * normal) - 1.0)
    np.testing.assert_allclose(measuring.thrust_estimate.ratio, expected, rtol=1e-12)
    assert float(plain.thrust_estimate.ratio) == 1.0
