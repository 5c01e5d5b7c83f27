"""Thrusters that fail in the steps of a tick: when they are shut off, and what they have given until then."""

import dataclasses
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import rpojax
from rpojax.campaign.single_run import initialise_run
from rpojax.core.pytree import pytree, replace
from rpojax.flight.control import rcs_control, thruster_isolation
from rpojax.flight.stages import Stages
from rpojax.physics import rcs_thrusters
from rpojax.physics.equipment_faults import KINDS
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import reaction_control, step_stages
from rpojax.simulation.state import State
from rpojax.simulation.tick import Loop, Motion

RK4_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0
STEP, STEPS, FORCE = 0.2, 20, 0.25
THRUSTER = 4


@pytree
class Watched:
    """Series over the steps: impulse (steps, 3) [N s], time of the command to isolate (steps, n), and open times."""

    impulse_B: Any
    shut_at: Any
    known_s: Any


@pytest.fixture(scope="module")
def failure() -> tuple[Scenario, Params, State]:
    """The packaged scenario without plumes, at its start."""
    return initialise_run(scenario_loader.load("thruster_failure", ["effects.plume=false"]))


@partial(jax.jit, static_argnums=0)
def fly(scenario: Scenario, params: Params, state: State, shares: Any, normals: Any) -> Watched:
    """Steps of 0.2 s from the start on with constant shares of thrust, and normals (steps, n) of the sensors."""
    loop = Loop(scenario, params, Stages())
    assert params.flight.thrusters is not None
    rcs = replace(rcs_control.no_command(params.flight.thrusters, scenario.isolation), shares=shares)
    none = jnp.zeros(scenario.thrusters)
    true = rcs_thrusters.true_state(rcs_thrusters.stacked(params.plant.thrusters), none, none + 1.0)
    sensed = step_stages.sense(loop, state)
    tick = replace(sensed, flight=replace(sensed.flight, rcs=rcs), thrusters=true)

    def step(motion: Motion, inputs: Any) -> tuple[Motion, Watched]:
        number, normal = inputs
        offset = STEP * number
        thrust, after, on_time = reaction_control.pulses(loop, tick, motion, offset)
        if scenario.isolation:
            after = reaction_control.watched(loop, tick, after, on_time, offset, normal)
            assert after.isolation is not None
        shut_at = none + jnp.inf if after.isolation is None else after.isolation.shut_at
        known = none if after.uncommanded is None else after.uncommanded.time
        impulse = STEP * jnp.sum(jnp.asarray(RK4_WEIGHTS)[:, None] * thrust.force_B, axis=0)
        return after, Watched(impulse_B=impulse, shut_at=shut_at, known_s=known)

    start, numbers = step_stages.initial_motion(tick), jnp.arange(STEPS, dtype=float)
    return jax.lax.scan(step, start, (numbers, normals))[1]


def with_fault(params: Params, start: float, kind: str = "thruster_stuck_open", severity: float = 0.5) -> Params:
    """Parameters with a fault of thruster 4."""
    fault = replace(
        params.plant.faults["fault"],
        kind=jnp.array(float(KINDS.index(kind))),
        start=jnp.array(start),
        thruster=jnp.array(float(THRUSTER)),
        severity=jnp.array(severity),
    )
    return replace(params, plant=replace(params.plant, faults={"fault": fault}))


def flown(scenario: Scenario, params: Params, state: State, shares: float = 0.0, seed: int = 0) -> Watched:
    """Series with equal shares of all thrusters and the sensors' noise."""
    rng = np.random.default_rng(seed)
    normals = jnp.asarray(rng.normal(size=(STEPS, scenario.thrusters)))
    return fly(scenario, params, state, jnp.full(scenario.thrusters, shares), normals)


def direction(params: Params) -> np.ndarray:
    """Unit force of thruster 4 in B."""
    forces = np.array(rcs_thrusters.nominal_forces(rcs_thrusters.stacked(params.plant.thrusters)))
    return forces[THRUSTER] / FORCE


@pytest.mark.parametrize("start", [0.0, 0.05, 0.2, 0.31, 0.599, 1.01])
@pytest.mark.parametrize("shares", [0.0, 0.3])
def test_a_stuck_thruster_is_shut_within_two_seconds_and_gives_the_impulse_until_then(
    failure: tuple[Scenario, Params, State], start: float, shares: float
) -> None:
    scenario, params, state = failure
    found = flown(scenario, with_fault(params, start), state, shares)
    shut_at = np.array(found.shut_at[-1])
    # The third sample at the end of a step: that in which it fails is the first one, where it ends within it.
    command = STEP * (np.floor(start / STEP + 1e-9) + 3.0)
    assert shut_at[THRUSTER] == pytest.approx(command)
    assert np.isinf(np.delete(shut_at, THRUSTER)).all()
    delay = shut_at[THRUSTER] + 0.5 - start
    assert 0.9 - 1e-9 <= delay <= 1.1 + 1e-9
    impulse = np.array(found.impulse_B).sum(axis=0)
    if shares == 0.0:
        assert np.allclose(impulse, FORCE * delay * direction(params), atol=1e-12)
        # What flight software knows of it differs by less than a step, and some noise.
        assert abs(np.array(found.known_s)[-1, THRUSTER] - delay) < 0.5 * STEP + 0.05
        assert np.array(found.known_s)[-1].sum() == np.array(found.known_s)[-1, THRUSTER]
    # After the valve is shut the others alone push, and this one lacks.
    last = np.array(found.impulse_B)[-1]
    assert np.allclose(last, -STEP * shares * FORCE * direction(params), atol=2e-3 if shares else 1e-15)


@pytest.mark.parametrize(
    ("kind", "severity", "share"),
    [("thruster_leak", 0.1, 0.1), ("thruster_off", 0.5, 0.0), ("thruster_weak", 0.5, 0.0), ("none", 0.5, 0.0)],
)
def test_a_leak_below_the_limit_goes_on_and_other_faults_isolate_nothing(
    failure: tuple[Scenario, Params, State], kind: str, severity: float, share: float
) -> None:
    scenario, params, state = failure
    found = flown(scenario, with_fault(params, 0.3, kind, severity), state)
    assert np.isinf(np.array(found.shut_at)).all()
    expected = share * FORCE * (STEPS * STEP - 0.3) * direction(params)
    assert np.allclose(np.array(found.impulse_B).sum(axis=0), expected, atol=1e-12)


def test_two_faults_each_push_by_their_own_thruster_from_their_own_time(
    failure: tuple[Scenario, Params, State],
) -> None:
    scenario, params, state = failure
    first = with_fault(params, 0.3, "thruster_leak", 0.1).plant.faults["fault"]
    other = THRUSTER + 1
    second = replace(first, start=jnp.array(1.1), severity=jnp.array(0.2), thruster=jnp.array(float(other)))
    one, both = (
        flown(scenario, replace(params, plant=replace(params.plant, faults=faults)), state)
        for faults in ({"a": first}, {"a": first, "b": second})
    )
    before = round(1.0 / STEP)
    assert np.array_equal(np.array(both.impulse_B)[:before], np.array(one.impulse_B)[:before])
    forces = np.array(rcs_thrusters.nominal_forces(rcs_thrusters.stacked(params.plant.thrusters)))
    expected = 0.1 * (STEPS * STEP - 0.3) * forces[THRUSTER] + 0.2 * (STEPS * STEP - 1.1) * forces[other]
    assert np.allclose(np.array(both.impulse_B).sum(axis=0), expected, atol=1e-12)


def test_leaks_of_one_thruster_add_up_to_its_full_force(failure: tuple[Scenario, Params, State]) -> None:
    scenario, params, state = failure
    first = with_fault(params, 0.4, "thruster_leak", 0.2).plant.faults["fault"]
    limit = replace(params.flight.isolation, pressure=jnp.array(2.0))  # nothing is isolated
    params = replace(params, flight=replace(params.flight, isolation=limit))
    for severity, share in ((0.1, 0.3), (0.9, 1.0)):
        second = replace(first, start=jnp.array(1.0), severity=jnp.array(severity))
        found = flown(scenario, replace(params, plant=replace(params.plant, faults={"a": first, "b": second})), state)
        expected = FORCE * (0.2 * 0.6 + share * (STEPS * STEP - 1.0)) * direction(params)
        assert np.allclose(np.array(found.impulse_B).sum(axis=0), expected, atol=1e-12)


def test_a_leak_above_the_limit_is_isolated(failure: tuple[Scenario, Params, State]) -> None:
    scenario, params, state = failure
    found = flown(scenario, with_fault(params, 0.3, "thruster_leak", 0.6), state)
    assert float(found.shut_at[-1, THRUSTER]) == pytest.approx(0.8)
    assert np.allclose(np.array(found.impulse_B).sum(axis=0), 0.6 * FORCE * 1.0 * direction(params), atol=1e-12)


def test_without_isolation_or_without_propellant(failure: tuple[Scenario, Params, State]) -> None:
    scenario, params, _ = failure
    stuck = with_fault(params, 0.3)
    file = scenario_loader.load("thruster_failure", ["effects.plume=false", "chamber_pressure.enabled=false"])
    without, _, state = initialise_run(file)
    assert not without.isolation
    impulse = np.array(flown(without, stuck, state).impulse_B).sum(axis=0)
    assert np.allclose(impulse, FORCE * (STEPS * STEP - 0.3) * direction(params), atol=1e-12)
    empty = replace(stuck, limits=replace(stuck.limits, propellant=jnp.array(-1.0)))
    found = flown(scenario, empty, failure[2])
    assert np.all(np.array(found.impulse_B) == 0.0)
    assert np.isinf(np.array(found.shut_at)).all()


@pytest.mark.parametrize(
    ("kind", "time", "shut_at", "expected"),
    [
        ("thruster_stuck_open", 99.0, np.inf, np.nan),
        ("thruster_stuck_open", 100.5, np.inf, 0.5),
        ("thruster_stuck_open", 500.0, 100.6, 1.1),
        ("thruster_stuck_open", 500.0, np.inf, 400.0),
        ("thruster_stuck_open", 2000.0, np.inf, 1000.0),  # the fault is over
        ("thruster_leak", 500.0, 100.6, np.nan),
        ("thruster_off", 500.0, np.inf, np.nan),
    ],
)
def test_the_delay_of_an_isolation_is_the_time_for_which_the_thruster_can_burn(
    failure: tuple[Scenario, Params, State], kind: str, time: float, shut_at: float, expected: float
) -> None:
    scenario, params, _ = failure
    plant = with_fault(params, 100.0, kind).plant
    lasting = replace(plant.faults["fault"], duration=jnp.array(1000.0))
    plant = replace(plant, faults={"fault": lasting})
    assert params.flight.thrusters is not None
    isolation = thruster_isolation.initial(params.flight.thrusters)
    isolation = replace(isolation, shut_at=isolation.shut_at.at[THRUSTER].set(shut_at).at[0].set(3.0))
    found = float(reaction_control.stuck_open_time(scenario, plant, isolation, jnp.array(time)))
    assert found == pytest.approx(expected, nan_ok=True)
    # The command to shut the valve is late as all commands are.
    late = dataclasses.replace(scenario, command_steps=2)
    later = float(reaction_control.stuck_open_time(late, plant, isolation, jnp.array(time)))
    is_shut = shut_at < time and kind == "thruster_stuck_open"
    assert later == pytest.approx(expected + (2 * scenario.step_s if is_shut else 0.0), nan_ok=True)


@pytest.mark.slow
def test_every_stuck_thruster_of_the_packaged_scenario_is_shut_off_and_no_other(tmp_path: Path) -> None:
    campaign = rpojax.run_campaign(rpojax.load("thruster_failure"), runs=12, out=tmp_path / "runs", seed=7)
    delay, shut = (campaign.metrics[name] for name in ("isolation_delay_s", "isolated_thrusters"))
    stuck = campaign.drawn["faults.fault.kind"] == KINDS.index("thruster_stuck_open")
    assert 0 < stuck.sum() < 12
    np.testing.assert_array_equal(np.isfinite(delay), stuck)
    np.testing.assert_array_equal(shut, stuck)
    assert np.all((delay[stuck] >= 0.9) & (delay[stuck] <= 2.0))
    assert "keep_out" not in campaign.outcomes
