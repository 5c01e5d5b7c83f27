"""One tick of the closed loop against the scan of many."""

import jax
import jax.numpy as jnp
import numpy as np
from short_run import STAGES, TICKS, Run, assert_close

from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.state import State
from rpojax.simulation.step import step

tick = jax.jit(step, static_argnums=(0, 3))


def test_telemetry_has_the_state_at_the_beginning_of_the_tick(run: Run, start: State) -> None:
    _, telemetry = run
    np.testing.assert_array_equal(telemetry.truth.r_ST_N[0], start.truth.r_ST_N)
    np.testing.assert_array_equal(telemetry.truth.q_BN[0], start.truth.q_BN)


def test_a_loop_of_steps_equals_the_rollout(loop: tuple[Scenario, Params], start: State, run: Run) -> None:
    scenario, params = loop
    state, telemetries = start, []
    for _ in range(TICKS):
        state, telemetry = tick(scenario, params, state, STAGES)
        telemetries.append(telemetry)
    assert_close(state, run[0])
    assert_close(jax.tree.map(lambda *leaves: jnp.stack(leaves), *telemetries), run[1])
