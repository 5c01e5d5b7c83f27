"""Late commands: wheels and thrusters do the same as with commands at once, a whole number of steps later."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import rpojax
from rpojax.core.pytree import replace
from rpojax.errors import ScenarioError
from rpojax.flight.stages import Stages
from rpojax.simulation import command_delay, step_stages
from rpojax.simulation.tick import Loop
from tests.scenario_error_assertions import assert_one_line


def test_commands_come_in_their_order_after_the_delay() -> None:
    waiting = command_delay.none_under_way(3, 2, jnp.zeros(())).on_time
    commands = np.arange(1.0, 15.0).reshape(7, 2)
    found = []
    for each in commands:
        oldest, waiting = command_delay.exchanged(waiting, jnp.asarray(each))
        found.append(np.asarray(oldest))
    np.testing.assert_array_equal(found[:3], np.zeros((3, 2)))
    np.testing.assert_array_equal(found[3:], commands[:4])


def test_a_late_torque_turns_the_servicer_as_a_torque_at_once_does_later() -> None:
    """Without attitude control the plant is the same from step to step: its rates are those of earlier torques."""
    torques = jnp.asarray(np.random.default_rng(1).normal(0.0, 1e-3, (6, 3)))

    def rates(delay_s: float) -> np.ndarray:
        scenario, params = rpojax.nominal_parameters(rpojax.load("inspection", [f"rates.command_delay_s={delay_s}"]))
        loop = Loop(scenario, params, Stages())

        @jax.jit
        def all_steps() -> jax.Array:
            state = rpojax.init(scenario, params, rpojax.run_key(0, 0))
            # The same free rotation in both, so that only the torques differ.
            state = replace(state, truth=replace(state.truth, omega_BN_B=jnp.zeros(3)))
            tick = step_stages.sense(loop, state)
            motion, found = step_stages.initial_motion(tick), []
            for each in torques:
                motion = step_stages.propagate_substep(loop, tick, motion, each, jnp.zeros(()), jnp.zeros(3))
                found.append(motion.truth.wheel_speed)
            return jnp.stack(found)

        return np.asarray(all_steps())

    at_once, late = rates(0.0), rates(0.4)
    np.testing.assert_allclose(late[:2], np.broadcast_to(late[0], (2, 3)), atol=1e-6)
    np.testing.assert_allclose(np.diff(late, axis=0)[2:], np.diff(at_once, axis=0)[:3], rtol=1e-3)


@pytest.mark.parametrize("delay_s", [0.3, 3.0])
def test_a_delay_that_is_no_number_of_steps_or_too_long_is_refused(delay_s: float) -> None:
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("inspection", [f"rates.command_delay_s={delay_s}"])
    assert_one_line(refused.value, "rates.command_delay_s", "whole number of plant steps")
