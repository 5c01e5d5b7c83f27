"""Closed-loop runs: finite, reproducible, on target, and under the formation law of the user."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from short_run import LIMIT, STAGES, TICKS, Run, assert_close, init, rollout

from rpojax.core.pytree import replace
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.noise import run_key
from rpojax.simulation.state import State
from rpojax.simulation.telemetry import Telemetry


def assert_finite(state: State, telemetry: Telemetry) -> None:
    """Asserts that all numbers are finite, except times of what has not happened."""
    for flight, rest in ((state.flight, (state.truth, state.sensor_errors)), (telemetry.flight, telemetry)):
        failed_at = flight.thruster_failed_at
        assert np.all(np.isfinite(failed_at) | np.isneginf(failed_at))
        mission = replace(
            flight.mission, arrived_at=jnp.zeros(()), known_at=jnp.zeros(()), attitude_known_at=jnp.zeros(())
        )
        known = replace(flight, thruster_failed_at=jnp.zeros(()), mission=mission)
        shown = replace(rest, flight=known) if isinstance(rest, Telemetry) else rest
        for leaf in jax.tree.leaves((shown, known)):
            assert np.all(np.isfinite(leaf))


def test_a_run_stays_finite_and_does_not_fail(run: Run) -> None:
    state, telemetry = run
    assert_finite(state, telemetry)
    assert np.all(np.isneginf(telemetry.flight.thruster_failed_at))
    assert int(state.failure) == 0
    assert np.isinf(state.failed_at)
    assert int(state.tick) == TICKS
    assert np.all(telemetry.running)


def test_the_target_is_acquired_and_tracked(run: Run) -> None:
    _, telemetry = run
    accepted = np.asarray(telemetry.innovation.sensors["box"].accepted)
    assert accepted[:10].any()
    looking = (np.asarray(telemetry.mode) == Mode.LOOK) & (np.arange(TICKS) > 10)
    assert looking.sum() > 20
    # One frame in twenty is missed and one in twenty is false.
    assert accepted[looking].mean() > 0.7
    assert not np.any(accepted & np.asarray(telemetry.frame.outlier))


def test_the_estimation_error_decreases(run: Run) -> None:
    _, telemetry = run
    error = np.asarray(telemetry.flight.orbit.relative.r_TS_N + telemetry.truth.r_ST_N)
    offset = np.asarray(telemetry.truth.r_ST_N)
    line = offset / np.linalg.norm(offset, axis=1, keepdims=True)
    across = np.linalg.norm(error - np.sum(error * line, axis=1, keepdims=True) * line, axis=1)
    assert across[-10:].max() < 0.3  # 1.5 m per axis at the start
    assert across[0] > across[-10:].max()


@partial(jax.jit, static_argnums=0)
def batched(scenario: Scenario, params: Params, states: State) -> Run:
    """Runs of a batch of initial states."""
    return jax.vmap(lambda state: rollout(scenario, params, state, TICKS, STAGES))(states)


@pytest.mark.slow
def test_a_batch_of_one_equals_the_single_run(loop: tuple[Scenario, Params], start: State, run: Run) -> None:
    found = batched(*loop, jax.tree.map(lambda leaf: leaf[None], start))
    assert_close(jax.tree.map(lambda leaf: leaf[0], found), run)


def test_a_run_depends_on_seed_and_run_number_only(loop: tuple[Scenario, Params], start: State, run: Run) -> None:
    again = rollout(*loop, init(*loop, run_key(1, 0)), TICKS, STAGES)
    jax.tree.map(np.testing.assert_array_equal, again, run)
    for key in (run_key(1, 1), run_key(2, 0)):
        other = init(*loop, key)
        assert np.max(np.abs(other.flight.orbit.relative.r_TS_N - start.flight.orbit.relative.r_TS_N)) > 0.01
        assert np.max(np.abs(other.sensor_errors.gps_bias_N - start.sensor_errors.gps_bias_N)) > 0.01


def test_the_formation_law_of_the_user_determines_the_burns(run: Run) -> None:
    state, telemetry = run
    # The LQR alone would command ten times as much; the execution error of the burn is one per cent.
    np.testing.assert_allclose(state.truth.delta_v, LIMIT, rtol=0.05)
    gained = np.asarray(telemetry.truth.delta_v)
    assert gained[57] < 1e-15
    np.testing.assert_allclose(gained[63:], state.truth.delta_v, rtol=1e-12)
    assert set(np.asarray(telemetry.mode)[58:62].tolist()) == {Mode.BURN}
