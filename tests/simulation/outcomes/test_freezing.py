"""Runs that fail are frozen with time and reason."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from short_run import STAGES, TICKS, init, rollout

from rpojax.core.pytree import replace
from rpojax.scenario import params as parameters
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.noise import run_key
from rpojax.simulation.outcomes.outcome_kinds import REASONS
from rpojax.simulation.state import State


def test_a_run_that_starts_inside_the_keep_out_sphere_is_frozen(loop: tuple[Scenario, Params]) -> None:
    scenario, params = loop
    near = replace(params, initial=replace(params.initial, relative_position=jnp.array([0.0, -9.0, 0.0])))
    before = init(scenario, near, run_key(1, 0))
    state, telemetry = rollout(scenario, near, before, TICKS, STAGES)
    assert REASONS[int(state.failure)] == "entered the keep-out sphere"
    assert float(state.failed_at) == 0.0
    assert np.asarray(telemetry.running).tolist() == [True] + [False] * (TICKS - 1)
    assert int(state.tick) == TICKS
    jax.tree.map(np.testing.assert_array_equal, state.truth, before.truth)


def test_a_run_fails_when_it_enters_the_keep_out_sphere(loop: tuple[Scenario, Params]) -> None:
    scenario, params = loop
    initial = replace(
        params.initial, relative_position=jnp.array([0.0, -15.0, 0.0]), relative_velocity=jnp.array([0.0, 0.2, 0.0])
    )
    falling = replace(params, initial=initial)
    state, telemetry = rollout(scenario, falling, init(scenario, falling, run_key(1, 0)), TICKS, STAGES)
    assert REASONS[int(state.failure)] == "entered the keep-out sphere"
    np.testing.assert_allclose(state.failed_at, 25.0, atol=1.0)  # five metres at 0.2 m/s
    distance = np.linalg.norm(telemetry.truth.r_ST_N, axis=1)
    assert distance.min() > 10.0
    assert np.asarray(telemetry.running).sum() == float(state.failed_at) + 1.0


def test_a_non_finite_run_keeps_its_last_finite_state(loop: tuple[Scenario, Params], start: State) -> None:
    scenario, params = loop
    broken = parameters.replace_leaf(params, ("plant", "thruster", "force"), jnp.full((), np.nan, dtype=jnp.float64))
    state, _ = rollout(scenario, broken, start, TICKS, STAGES)
    assert REASONS[int(state.failure)] == "non-finite state"
    for leaf in jax.tree.leaves(state.truth):
        assert np.all(np.isfinite(leaf))


@pytest.mark.parametrize("name", ["servicer", "relative", "attitude"])
def test_one_non_finite_covariance_element_fails_the_run_within_two_ticks(
    loop: tuple[Scenario, Params], start: State, name: str
) -> None:
    scenario, params = loop
    flight = start.flight
    holder = flight if name == "attitude" else flight.orbit
    estimate = getattr(holder, name)
    broken_estimate = replace(estimate, covariance=estimate.covariance.at[3, 5].set(jnp.nan).at[5, 3].set(jnp.nan))
    orbit = flight.orbit if name == "attitude" else replace(flight.orbit, **{name: broken_estimate})
    flight = replace(flight, orbit=orbit, **({"attitude": broken_estimate} if name == "attitude" else {}))
    state, _ = rollout(scenario, params, replace(start, flight=flight), TICKS, STAGES)
    assert REASONS[int(state.failure)] == "non-finite state"
    assert float(state.failed_at) <= 1.0
