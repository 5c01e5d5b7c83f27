"""Attitude of the target in the closed loop: found, kept through a tumble, and found again where it is wrong."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.campaign.single_run import initialise_run
from rpojax.core import quaternion
from rpojax.core.pytree import replace
from rpojax.flight.stages import Stages
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.channels import compute_channels
from rpojax.simulation.state import State
from rpojax.simulation.step import step

pytestmark = pytest.mark.slow


class Records(NamedTuple):
    """Of each tick.

    Attributes:
        known: (t,) bool
        error_deg: (t, 3)
        sigma_deg: (t, 3)
        rate_error_deg_s: (t, 3)
    """

    known: np.ndarray
    error_deg: np.ndarray
    sigma_deg: np.ndarray
    rate_error_deg_s: np.ndarray


@functools.cache
def start() -> tuple[Scenario, Params, State]:
    return initialise_run(scenario_loader.load("pose_inspection"), 3, 0)


@functools.partial(jax.jit, static_argnums=(0, 3))
def simulated(static: Scenario, params: Params, state: State, ticks: int) -> tuple[State, tuple[jax.Array, ...]]:
    names = ["known", "error_T_deg", "sigma_T_deg"]
    recorded = [*(f"target_attitude_{name}" for name in names), "target_rate_error_T_deg_s"]

    def tick(state: State, _: None) -> tuple[State, tuple[jax.Array, ...]]:
        after, telemetry = step(static, params, state, Stages())
        channels = compute_channels(static, params, telemetry)
        return after, tuple(channels[name] for name in recorded)

    return jax.lax.scan(tick, state, None, length=ticks)


def run(state: State) -> tuple[State, Records]:
    after, found = simulated(*start()[:2], state, 60)
    return after, Records(*map(np.asarray, found))


@functools.cache
def first_minute() -> tuple[State, Records]:
    return run(start()[2])


def test_the_attitude_is_found_without_a_guess_and_then_the_rate() -> None:
    _, found = first_minute()
    assert not found.known[0] or np.linalg.norm(found.rate_error_deg_s[0]) > 0.1
    assert found.known[20:].all()
    late = slice(30, None)
    assert np.linalg.norm(found.error_deg[late], axis=1).max() < 2.0
    assert np.linalg.norm(found.rate_error_deg_s[late], axis=1).max() < 0.1
    assert (np.abs(found.error_deg[late]) < 4.5 * found.sigma_deg[late]).all()


@pytest.mark.parametrize("turn", [(2.0, 0.0, 0.0), (0.0, -1.0, 1.5)])
def test_an_attitude_that_is_wrong_and_believed_is_given_up_and_found_again(turn: tuple[float, float, float]) -> None:
    state, _ = first_minute()
    relative = state.flight.orbit.relative
    assert relative.target is not None
    q_TN = quaternion.multiply(quaternion.exp(jnp.asarray(turn)), relative.target.q_TN)
    wrong = replace(relative, target=replace(relative.target, q_TN=q_TN))
    flight = replace(state.flight, orbit=replace(state.flight.orbit, relative=wrong))
    _, found = run(replace(state, flight=flight))
    size = np.linalg.norm(found.error_deg, axis=1)
    assert size[:9].min() > 60.0, "it is believed at first"
    assert found.sigma_deg[:9].max() < 5.0
    assert size[30:].max() < 6.0
    assert found.known[30:].all()
