"""Tests of the pulses of the reaction control system: exact impulses, order of names, faults."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.constants import STANDARD_GRAVITY
from rpojax.core.pytree import replace
from rpojax.flight.control import rcs_control, thruster_allocation
from rpojax.flight.control.thruster_allocation import ThrusterLayout
from rpojax.physics import equipment_faults, rcs_thrusters
from rpojax.physics.equipment_faults import KINDS, Fault
from rpojax.physics.plume_impingement import Impingement
from rpojax.physics.rcs_thrusters import Leak, RcsThruster

RK4_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0
STEP = 0.2


def thruster(position: list[float], direction: list[float], force: float) -> RcsThruster:
    """One without errors."""
    return RcsThruster(
        position=jnp.array(position),
        direction=jnp.array(direction),
        force=jnp.array(force),
        isp=jnp.array(60.0),
        minimum_on=jnp.array(0.02),
        force_scale=jnp.array(1.0),
        misalignment=jnp.zeros(3),
        pulse_noise=jnp.array(0.0),
    )


PAIR = {"b": thruster([0.0, 0.5, 0.0], [2.0, 0.0, 0.0], 0.3), "a": thruster([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 0.2)}


def believed_pair() -> ThrusterLayout:
    """The pair as flight software has it."""
    stacked = rcs_thrusters.stacked(PAIR)
    force, direction, position = (np.array(each) for each in (stacked.force, stacked.direction, stacked.position))
    wrench = thruster_allocation.wrench_matrix(force, direction, position)
    return thruster_allocation.layout(
        wrench, np.array(rcs_thrusters.nominal_flows(stacked)), np.array(stacked.minimum_on)
    )


def test_impulse_and_angular_impulse_of_a_step_are_exact() -> None:
    stacked = rcs_thrusters.stacked(PAIR)
    on_time = jnp.array([0.05, 0.2])
    thrust = rcs_thrusters.thrust_over_step(
        rcs_thrusters.true_state(stacked, jnp.zeros(2), jnp.ones(2)), on_time, "rk4", STEP
    )
    # In the order of names: a along y at z = 1 m, b along x at y = 0.5 m.
    assert np.allclose(STEP * RK4_WEIGHTS @ np.array(thrust.force_B), [0.3 * 0.2, 0.2 * 0.05, 0.0], atol=1e-15)
    moment = [-1.0 * 0.2 * 0.05, 0.0, -0.5 * 0.3 * 0.2]
    assert np.allclose(STEP * RK4_WEIGHTS @ np.array(thrust.moment_B), moment, atol=1e-15)
    used = (0.2 * 0.05 + 0.3 * 0.2) / (60.0 * STANDARD_GRAVITY)
    assert STEP * RK4_WEIGHTS @ np.array(thrust.mass_flow) == pytest.approx(used, rel=1e-12)


def leak(share: float, begin: float, end: float) -> Leak:
    """Of the second one, from `begin` to `end` [s] from the begin of the step."""
    return Leak(share=jnp.array([0.0, share]), begin=jnp.array(begin), end=jnp.array([0.0, end]))


@pytest.mark.parametrize(
    ("begin", "end", "pulse", "open_s"),
    [
        (-3.0, 9.0, 0.0, 0.2),  # stuck open all the time
        (-3.0, 9.0, 0.2, 0.2),  # as long as a pulse: no second force
        (-3.0, 9.0, 0.07, 0.2),  # goes on after a pulse
        (0.13, 9.0, 0.0, 0.07),  # fails within the step
        (0.13, 9.0, 0.05, 0.12),  # after a pulse
        (0.13, 9.0, 0.16, 0.2),  # during one
        (-3.0, 0.11, 0.0, 0.11),  # is isolated within the step
        (0.04, 0.11, 0.0, 0.07),
        (0.25, 9.0, 0.03, 0.03),  # fails after the step
        (-3.0, -1.0, 0.03, 0.03),  # was isolated before it
        (0.15, 0.05, 0.03, 0.03),  # was over before it could begin
    ],
)
@pytest.mark.parametrize("share", [1.0, 0.1])
def test_a_thruster_that_leaks_gives_the_exact_impulse_of_its_open_time(
    begin: float, end: float, pulse: float, open_s: float, share: float
) -> None:
    state = rcs_thrusters.true_state(rcs_thrusters.stacked(PAIR), jnp.zeros(2), jnp.ones(2))
    load = Impingement(force_N=2.0 * state.force_B, torque_T=3.0 * state.force_B, size=jnp.array([5.0, 7.0]))
    given = rcs_thrusters.thrust_over_step(
        replace(state, plume=load), jnp.array([0.05, pulse]), "rk4", STEP, [leak(share, begin, end)]
    )
    time = pulse + share * (open_s - pulse)
    force = np.array([0.3 * time, 0.2 * 0.05, 0.0])
    assert np.allclose(STEP * RK4_WEIGHTS @ np.array(given.force_B), force, atol=1e-15)
    moment = [-1.0 * 0.2 * 0.05, 0.0, -0.5 * 0.3 * time]
    assert np.allclose(STEP * RK4_WEIGHTS @ np.array(given.moment_B), moment, atol=1e-15)
    used = (0.2 * 0.05 + 0.3 * time) / (60.0 * STANDARD_GRAVITY)
    assert STEP * RK4_WEIGHTS @ np.array(given.mass_flow) == pytest.approx(used, rel=1e-12)
    assert given.plume is not None
    assert np.allclose(STEP * RK4_WEIGHTS @ np.array(given.plume.force_N), 2.0 * force, atol=1e-15)
    assert np.allclose(STEP * RK4_WEIGHTS @ np.array(given.plume.torque_T), 3.0 * force, atol=1e-15)
    assert STEP * RK4_WEIGHTS @ np.array(given.plume.size) == pytest.approx(5.0 * 0.05 + 7.0 * time, rel=1e-12)


@pytest.mark.parametrize(
    ("kind", "share"), [("thruster_stuck_open", 1.0), ("thruster_leak", 0.4), ("thruster_off", 0.0), ("none", 0.0)]
)
def test_a_fault_lets_its_thruster_leak(kind: str, share: float) -> None:
    fault = Fault(
        kind=jnp.array(float(KINDS.index(kind))), start=jnp.array(10.0), duration=jnp.array(5.0),
        severity=jnp.array(0.4), wheel=jnp.array(0.0), thruster=jnp.array(1.0),
    )  # fmt: skip
    assert np.array_equal(equipment_faults.leak_shares(fault, 3), [0.0, share, 0.0])
    assert np.array_equal(equipment_faults.is_stuck_open(fault, 3), [False, share == 1.0, False])
    if share:
        assert np.array_equal(equipment_faults.rcs_fractions({"a": fault}, jnp.array(11.0), 3), np.ones(3))


def test_a_mapping_has_the_same_order_after_a_compiled_program() -> None:
    forces = rcs_thrusters.nominal_forces(rcs_thrusters.stacked(PAIR))
    compiled = jax.jit(lambda each: rcs_thrusters.nominal_forces(rcs_thrusters.stacked(each)))(PAIR)
    assert np.array_equal(forces, compiled)


def test_misalignment_turns_the_force() -> None:
    turned = {"a": replace(PAIR["a"], misalignment=jnp.array([0.0, 0.0, 0.5 * np.pi]))}
    state = rcs_thrusters.true_state(rcs_thrusters.stacked(turned), jnp.zeros(1), jnp.ones(1))
    assert np.allclose(np.abs(state.force_B[0]), [0.2, 0.0, 0.0], atol=1e-15)


def test_a_fault_takes_the_force_of_its_thruster_for_its_time() -> None:
    fault = Fault(
        kind=jnp.array(float(KINDS.index("thruster_weak"))), start=jnp.array(10.0), duration=jnp.array(5.0),
        severity=jnp.array(0.4), wheel=jnp.array(0.0), thruster=jnp.array(1.0),
    )  # fmt: skip
    times = (9.0, 10.0, 14.9, 15.0)
    left = [np.array(equipment_faults.rcs_fractions({"a": fault}, jnp.array(time), 3)) for time in times]
    assert np.allclose(left, [[1, 1, 1], [1, 0.6, 1], [1, 0.6, 1], [1, 1, 1]])


def test_pulses_give_what_was_commanded_and_none_is_too_short() -> None:
    believed = believed_pair()
    shares = jnp.array([0.013, 0.85])
    command = replace(rcs_control.no_command(believed), shares=shares, acts=jnp.array(True))
    owed, given = command.owed, []
    for _ in range(500):
        on_time, owed = rcs_control.pulses(believed, command, owed, STEP)
        given.append(np.array(on_time))
    pulses = np.array(given)
    assert np.all((pulses == 0.0) | (pulses >= 0.02))
    assert np.all(pulses <= STEP)
    assert np.allclose(pulses.sum(axis=0) + np.array(owed), 500 * STEP * np.array(shares), rtol=1e-12)
    assert np.all(np.array(owed) < 0.02)


def test_pressure_shows_a_failure_at_once_and_averages_noise() -> None:
    believed = believed_pair()
    before = rcs_control.no_command(believed)
    fired = jnp.array([0.1, 0.0])
    after = rcs_control.learn_ratios(before, jnp.array([0.0, 0.0]), fired)
    assert np.allclose(after.ratio, [0.0, 1.0])
    noisy = rcs_control.learn_ratios(before, jnp.array([1.03, 1.0]), fired)
    assert np.allclose(noisy.ratio, [1.0015, 1.0])
