"""The closed loop: one run of a minute and a half, seen from several sides."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.pytree import replace
from rpojax.flight.computer import Stages
from rpojax.flight.control import attitude_control, formation_law
from rpojax.flight.control.attitude_control import AttitudeCommand
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.scenario import params as parameters
from rpojax.scenario.loading import scenario_loader as scenarios
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario, static_settings
from rpojax.simulation import external_stages, initial_state, step_stages
from rpojax.simulation.external_stages import ExternalBurn
from rpojax.simulation.failure import FAILURE_REASONS
from rpojax.simulation.noise import run_key
from rpojax.simulation.rollout import rollout as scan_ticks
from rpojax.simulation.state import State, true_relative_state
from rpojax.simulation.step import step
from rpojax.simulation.step_stages import GuidedTick, Motion
from rpojax.simulation.telemetry import Telemetry

TICKS = 90

# Two programs of the same loop round differently; a minute and a half of feedback does not let that grow.
SAME = 1e-9

OVERRIDES = (
    "duration_s=90.0",
    "rates.formation_period_s=40.0",
    "pointing.look_away_limit_s=40.0",
    "formation.lead_s=20.0",
)
"""Burns soon enough for a short run: decided at 40 s, flown at 60 s."""

Run = tuple[State, Telemetry]


LIMIT = 0.005
"""Largest velocity change of the law below [m/s]."""


def cautious(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """A user's own law: what the LQR wants, but never much at once."""
    wanted = formation_law.lqr_feedback(gain, deviation)
    return wanted * jnp.minimum(LIMIT / jnp.sqrt(jnp.sum(wanted**2)), 1.0)


STAGES = Stages(formation_law=cautious)

init = jax.jit(initial_state.init, static_argnums=0)
rollout = jax.jit(scan_ticks, static_argnums=(0, 3, 4))
tick = jax.jit(step, static_argnums=(0, 3))


@partial(jax.jit, static_argnums=0)
def batched(scenario: Scenario, params: Params, states: State) -> Run:
    return jax.vmap(lambda state: scan_ticks(scenario, params, state, TICKS, STAGES))(states)


@pytest.fixture(scope="module")
def loop() -> tuple[Scenario, Params]:
    file = scenarios.load("inspection", OVERRIDES)
    static = static_settings(file)
    return static, parameters.build_params(file.model_dump(), static.width_px, static.height_px)


@pytest.fixture(scope="module")
def start(loop: tuple[Scenario, Params]) -> State:
    return init(*loop, run_key(1, 0))


@pytest.fixture(scope="module")
def run(loop: tuple[Scenario, Params], start: State) -> Run:
    """The nominal mission under the user's law."""
    return rollout(*loop, start, TICKS, STAGES)


def assert_close(found: Any, expected: Any) -> None:
    """Checks that two like pytrees agree, each leaf relative to its largest number."""

    def one(path: Any, a: jax.Array, b: jax.Array) -> None:
        scale = 1.0 + float(np.max(np.abs(np.where(np.isfinite(b), b, 0.0)), initial=0.0))
        np.testing.assert_allclose(a, b, rtol=0.0, atol=SAME * scale, err_msg=jax.tree_util.keystr(path))

    jax.tree_util.tree_map_with_path(one, found, expected)


def assert_finite(state: State, telemetry: Telemetry) -> None:
    """Checks every number but the time of the thruster's last failure, which is minus infinity before the first."""
    for flight, rest in ((state.flight, (state.truth, state.sensor_errors)), (telemetry.flight, telemetry)):
        failed_at = flight.thruster_failed_at
        assert np.all(np.isfinite(failed_at) | np.isneginf(failed_at))
        known = replace(flight, thruster_failed_at=jnp.zeros(()))
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


def test_a_run_finds_its_target_and_keeps_it_in_view(run: Run) -> None:
    _, telemetry = run
    accepted = np.asarray(telemetry.innovation.accepted)
    assert accepted[:10].any()
    looking = (np.asarray(telemetry.mode) == Mode.LOOK) & (np.arange(TICKS) > 10)
    assert looking.sum() > 20
    # One frame in twenty is missed and one in twenty is false.
    assert accepted[looking].mean() > 0.7
    assert not np.any(accepted & np.asarray(telemetry.frame.outlier))


def test_the_estimate_comes_closer_to_the_truth_than_the_hand_over_was(run: Run) -> None:
    _, telemetry = run
    error = np.asarray(telemetry.flight.orbit.relative.r_TS_N + telemetry.truth.r_ST_N)
    offset = np.asarray(telemetry.truth.r_ST_N)
    line = offset / np.linalg.norm(offset, axis=1, keepdims=True)
    across = np.linalg.norm(error - np.sum(error * line, axis=1, keepdims=True) * line, axis=1)
    assert across[-10:].max() < 0.3  # 1.5 m per axis at the start
    assert across[0] > across[-10:].max()


def test_telemetry_shows_the_state_at_the_beginning_of_each_tick(run: Run, start: State) -> None:
    _, telemetry = run
    np.testing.assert_array_equal(telemetry.truth.r_ST_N[0], start.truth.r_ST_N)
    np.testing.assert_array_equal(telemetry.truth.q_BN[0], start.truth.q_BN)


def test_a_scan_of_ticks_is_a_python_loop_of_ticks(loop: tuple[Scenario, Params], start: State, run: Run) -> None:
    scenario, params = loop
    state, seen = start, []
    for _ in range(TICKS):
        state, telemetry = tick(scenario, params, state, STAGES)
        seen.append(telemetry)
    assert_close(state, run[0])
    assert_close(jax.tree.map(lambda *leaves: jnp.stack(leaves), *seen), run[1])


NO_BURN = ExternalBurn(ignition=jnp.zeros(()), cutoff=jnp.zeros(()), q_burn=jnp.array([1.0, 0.0, 0.0, 0.0]))


def test_a_run_stepped_stage_by_stage_is_the_run(loop: tuple[Scenario, Params], start: State, run: Run) -> None:
    static, numbers = loop
    state, seen = start, []
    for _ in range(TICKS):
        begun = external_stages.sense_and_navigate(STAGES, static, numbers, state)
        decided, now = external_stages.plan_burn_and_guide(STAGES, static, "flight_software", numbers, state, begun, NO_BURN)
        motion = external_stages.control_and_propagate(STAGES, static, numbers, state, decided)
        state = external_stages.finish(STAGES, static, numbers, state, decided, motion)
        seen.append(now)
    assert_close(state, run[0])
    assert_close(jax.tree.map(lambda *leaves: jnp.stack(leaves), *seen), run[1])


def test_a_run_whose_burns_and_torques_are_given_from_outside_as_the_flight_software_would_is_the_run(
    loop: tuple[Scenario, Params], start: State, run: Run
) -> None:
    static, numbers = loop
    plans = run[1].flight.plan
    state, accelerations = start, []
    for tick in range(TICKS):
        # The same burn is told again and again, as one who does not know whether it has been heard would do.
        burn = ExternalBurn(ignition=plans.ignition[tick], cutoff=plans.cutoff[tick], q_burn=plans.q_burn[tick])
        begun = external_stages.sense_and_navigate(STAGES, static, numbers, state)
        decided, _ = external_stages.plan_burn_and_guide(STAGES, static, "external", numbers, state, begun, burn)
        motion = step_stages.initial_motion(state, decided)
        commands = external_stages.attitude_commands(static, decided)
        accelerations.append(float(jnp.max(jnp.abs(commands.acceleration_C))))
        for substep in range(static.substeps):
            command = jax.tree.map(lambda values, substep=substep: values[substep], commands)
            torque = wheel_torque(numbers, decided, motion, command)
            motion = external_stages.propagate_substep(static, numbers, state, decided, motion, torque, jnp.array(substep))
        state = external_stages.finish(STAGES, static, numbers, state, decided, motion)
    assert max(accelerations) > 0.01  # there was a turn to follow
    assert_close(state, run[0])


@jax.jit
def wheel_torque(numbers: Params, decided: GuidedTick, motion: Motion, command: AttitudeCommand) -> jax.Array:
    """What a controller from outside would do, if it were the packaged one."""
    flight = numbers.flight
    return attitude_control.wheel_torque(
        flight.attitude_control,
        flight.vehicle,
        decided.flight.wheel_allocation,
        motion.attitude,
        command,
        motion.truth.wheel_speed,
    )


def test_a_burn_that_is_called_off_from_outside_stops_at_once(
    loop: tuple[Scenario, Params], start: State, run: Run
) -> None:
    static, numbers = loop
    plan = jax.tree.map(lambda leaf: leaf[60], run[1].flight.plan)
    assert float(plan.ignition) < 60.0 < float(plan.cutoff) - 1.0
    state = replace(start, tick=jnp.array(60, dtype=jnp.int32), flight=replace(start.flight, plan=plan))
    begun = external_stages.sense_and_navigate(STAGES, static, numbers, state)
    decided, _ = external_stages.plan_burn_and_guide(STAGES, static, "external", numbers, state, begun, NO_BURN)
    left = decided.flight.plan
    np.testing.assert_array_equal([left.ignition, left.cutoff], [plan.ignition, 60.0])
    np.testing.assert_array_equal(decided.burn_error.magnitude, start.burn_error.magnitude)


def test_an_estimate_from_outside_takes_the_place_of_the_own(loop: tuple[Scenario, Params], start: State) -> None:
    begun = external_stages.sense_and_navigate(STAGES, *loop, start)
    servicer, relative = begun.flight.orbit.servicer, begun.flight.orbit.relative
    given = external_stages.ExternalOrbitEstimate(
        r_SN_N=servicer.r_SN_N + 1.0,
        v_SN_N=servicer.v_SN_N,
        r_TS_N=relative.r_TS_N,
        v_TS_N=relative.v_TS_N - 0.5,
        servicer_covariance=2.0 * servicer.covariance[:6, :6],
        relative_covariance=jnp.eye(6),
    )
    after = external_stages.replace_orbit_estimate(begun, given).flight.orbit
    np.testing.assert_array_equal(after.servicer.r_SN_N, servicer.r_SN_N + 1.0)
    np.testing.assert_array_equal(after.relative.v_TS_N, relative.v_TS_N - 0.5)
    np.testing.assert_array_equal(after.servicer.covariance[:6, :6], 2.0 * servicer.covariance[:6, :6])
    np.testing.assert_array_equal(after.servicer.covariance[6:, 6:], servicer.covariance[6:, 6:])
    np.testing.assert_array_equal(after.relative.covariance[:6, :6], np.eye(6))
    assert not np.any(after.relative.covariance[:6, 6:])
    assert np.all(np.linalg.eigvalsh(after.relative.covariance) > 0.0)


def test_a_run_in_a_batch_of_one_is_the_run_alone(loop: tuple[Scenario, Params], start: State, run: Run) -> None:
    found = batched(*loop, jax.tree.map(lambda leaf: leaf[None], start))
    assert_close(jax.tree.map(lambda leaf: leaf[0], found), run)


def test_a_run_depends_on_its_seed_and_number_and_on_nothing_else(
    loop: tuple[Scenario, Params], start: State, run: Run
) -> None:
    again = rollout(*loop, init(*loop, run_key(1, 0)), TICKS, STAGES)
    jax.tree.map(np.testing.assert_array_equal, again, run)
    for key in (run_key(1, 1), run_key(2, 0)):
        other = init(*loop, key)
        assert np.max(np.abs(other.flight.orbit.relative.r_TS_N - start.flight.orbit.relative.r_TS_N)) > 0.01
        assert np.max(np.abs(other.sensor_errors.gps_bias_N - start.sensor_errors.gps_bias_N)) > 0.01


def test_a_users_own_formation_law_decides_the_burns(run: Run) -> None:
    state, telemetry = run
    # The LQR alone would want ten times as much; the burn's execution error is a per cent.
    np.testing.assert_allclose(state.truth.delta_v, LIMIT, rtol=0.05)
    gained = np.asarray(telemetry.truth.delta_v)
    assert gained[57] < 1e-15
    np.testing.assert_allclose(gained[63:], state.truth.delta_v, rtol=1e-12)
    assert set(np.asarray(telemetry.mode)[58:62].tolist()) == {Mode.BURN}


def test_a_run_that_starts_inside_of_the_keep_out_sphere_fails_and_is_frozen(loop: tuple[Scenario, Params]) -> None:
    scenario, params = loop
    near = replace(params, initial=replace(params.initial, relative_position=jnp.array([0.0, -9.0, 0.0])))
    before = init(scenario, near, run_key(1, 0))
    state, telemetry = rollout(scenario, near, before, TICKS, STAGES)
    assert FAILURE_REASONS[int(state.failure)] == "entered the keep-out sphere"
    assert float(state.failed_at) == 0.0
    assert np.asarray(telemetry.running).tolist() == [True] + [False] * (TICKS - 1)
    assert int(state.tick) == TICKS
    jax.tree.map(np.testing.assert_array_equal, state.truth, before.truth)


def test_a_run_that_enters_the_keep_out_sphere_later_fails_then(loop: tuple[Scenario, Params]) -> None:
    scenario, params = loop
    initial = replace(
        params.initial, relative_position=jnp.array([0.0, -15.0, 0.0]), relative_velocity=jnp.array([0.0, 0.2, 0.0])
    )
    falling = replace(params, initial=initial)
    state, telemetry = rollout(scenario, falling, init(scenario, falling, run_key(1, 0)), TICKS, STAGES)
    assert FAILURE_REASONS[int(state.failure)] == "entered the keep-out sphere"
    np.testing.assert_allclose(state.failed_at, 25.0, atol=1.0)  # five metres at 0.2 m/s
    distance = np.linalg.norm(telemetry.truth.r_ST_N, axis=1)
    assert distance.min() > 10.0
    assert np.asarray(telemetry.running).sum() == float(state.failed_at) + 1.0


def test_a_run_that_becomes_non_finite_fails_and_keeps_its_last_finite_state(
    loop: tuple[Scenario, Params], start: State
) -> None:
    scenario, params = loop
    broken = parameters.replace_leaf(params, ("plant", "thruster", "force"), jnp.full((), np.nan, dtype=jnp.float64))
    state, _ = rollout(scenario, broken, start, TICKS, STAGES)
    assert FAILURE_REASONS[int(state.failure)] == "non-finite state"
    for leaf in jax.tree.leaves(state.truth):
        assert np.all(np.isfinite(leaf))


@pytest.mark.parametrize("name", ["servicer", "relative", "attitude"])
def test_a_covariance_with_one_number_that_is_not_finite_fails_the_run_within_two_ticks(
    loop: tuple[Scenario, Params], start: State, name: str
) -> None:
    scenario, params = loop
    flight = start.flight
    holder = flight if name == "attitude" else flight.orbit
    estimate = getattr(holder, name)
    spoilt = replace(estimate, covariance=estimate.covariance.at[3, 5].set(jnp.nan).at[5, 3].set(jnp.nan))
    orbit = flight.orbit if name == "attitude" else replace(flight.orbit, **{name: spoilt})
    flight = replace(flight, orbit=orbit, **({"attitude": spoilt} if name == "attitude" else {}))
    state, _ = rollout(scenario, params, replace(start, flight=flight), TICKS, STAGES)
    assert FAILURE_REASONS[int(state.failure)] == "non-finite state"
    assert float(state.failed_at) <= 1.0


def test_the_relative_state_at_the_start_is_the_scenarios(loop: tuple[Scenario, Params], start: State) -> None:
    rho, rho_dot = true_relative_state(start.truth)
    np.testing.assert_allclose(rho, loop[1].initial.relative_position, atol=1e-12)
    np.testing.assert_allclose(rho_dot, loop[1].initial.relative_velocity, atol=1e-14)


def test_hand_over_errors_and_slow_sensor_errors_have_their_standard_deviations(loop: tuple[Scenario, Params]) -> None:
    scenario, params = loop
    runs = 300

    def errors(run_id: int) -> list[jax.Array]:
        state = init(scenario, params, run_key(3, run_id))
        truth, orbit, sensors = state.truth, state.flight.orbit, state.sensor_errors
        return [
            np.asarray(orbit.servicer.r_SN_N) - truth.r_TN_N - truth.r_ST_N,
            np.asarray(orbit.servicer.v_SN_N) - truth.v_TN_N - truth.v_ST_N,
            np.asarray(orbit.relative.r_TS_N) + truth.r_ST_N,
            np.asarray(orbit.relative.v_TS_N) + truth.v_ST_N,
            sensors.gps_bias_N,
            sensors.gyro_bias_B,
        ]

    tuning = params.flight.navigation
    sigmas = (
        tuning.initial_position_sigma,
        tuning.initial_velocity_sigma,
        tuning.initial_relative_position_sigma,
        tuning.initial_relative_velocity_sigma,
        params.gps.bias_sigma,
        params.gyro.initial_bias_sigma,
    )
    drawn = [errors(run_id) for run_id in range(runs)]
    for values, sigma in zip(zip(*drawn, strict=True), sigmas, strict=True):
        np.testing.assert_allclose(np.std(np.stack(values)), sigma, rtol=4.0 / np.sqrt(2 * 3 * runs))  # four sigma
