"""The flight computer: what it solves at start, the velocity change it expects, and its replaceable stages."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scene
from reference import IDENTITY, MU, turn

from rpojax.core.pytree import replace
from rpojax.flight import computer, formation_control
from rpojax.flight.computer import FlightMemory, FlightParams, Stages
from rpojax.simulation.params import Params

delta_v_between = jax.jit(computer.delta_v_between)
start = jax.jit(computer.start, static_argnums=1)
plan_burn = jax.jit(computer.plan_burn, static_argnums=0)
control_attitude = jax.jit(computer.control_attitude, static_argnums=0)


@pytest.fixture(scope="module")
def flight(params: Params) -> FlightParams:
    return params.flight


@pytest.fixture(scope="module")
def memory(flight: FlightParams) -> FlightMemory:
    return start(flight, 200.0, scene.estimate(flight), IDENTITY, np.zeros(3))


def sure(memory: FlightMemory) -> FlightMemory:
    """The same with the target in sight."""
    pointing = replace(memory.pointing, acquired=jnp.asarray(True), sightings=jnp.float64(5.0))
    return replace(memory, pointing=pointing)


def test_the_gain_is_solved_for_the_targets_mean_motion_and_the_burn_period(
    flight: FlightParams, memory: FlightMemory
) -> None:
    n = np.sqrt(MU / np.linalg.norm(scene.R_SN_N) ** 3)
    expected = formation_control.lqr_gain(flight.formation, jnp.float64(n), 200.0)
    np.testing.assert_allclose(memory.gain, expected, rtol=1e-3)  # the target flies 30 m ahead, a hair faster


def test_the_allocation_undoes_the_wheel_axes(flight: FlightParams) -> None:
    axes = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.6, 0.8]])
    skew = replace(flight, onboard=replace(flight.onboard, wheel_axes=jnp.asarray(axes)))
    memory = start(skew, 200.0, scene.estimate(flight), IDENTITY, np.zeros(3))
    np.testing.assert_allclose(axes.T @ np.asarray(memory.allocation), np.eye(3), atol=1e-15)


def test_the_expected_velocity_changes_of_all_intervals_add_up_to_the_whole_burn(
    flight: FlightParams, memory: FlightMemory
) -> None:
    q_BN = turn([0.0, 0.0, 1.0], -np.pi / 2)  # body x lies along y of N
    plan = replace(memory.plan, ignition=jnp.float64(3.3), cutoff=jnp.float64(8.75))
    burning = replace(memory, plan=plan, attitude=replace(memory.attitude, q_BN=jnp.asarray(q_BN)))
    edges = 0.2 * np.arange(61)
    parts = [np.asarray(delta_v_between(flight, burning, a, b)) for a, b in itertools.pairwise(edges)]
    np.testing.assert_allclose(np.sum(parts, axis=0), [0.0, 1e-3 * (8.75 - 3.3), 0.0], atol=1e-15)
    np.testing.assert_array_equal(parts[0], np.zeros(3))
    np.testing.assert_allclose(parts[20], [0.0, 1e-3 * 0.2, 0.0], atol=1e-15)


def test_a_users_control_law_decides_the_burn(flight: FlightParams, memory: FlightMemory) -> None:
    def sideways(gain: jax.Array, deviation: jax.Array) -> jax.Array:
        return jnp.array([0.0, 0.0, 0.005])

    found = plan_burn(Stages(formation_law=sideways), flight, sure(memory), scene.SUN, np.float64(0.0)).plan
    normal = np.cross(scene.R_SN_N, scene.V_SN_N)
    np.testing.assert_allclose(found.delta_v_N, 0.005 * normal / np.linalg.norm(normal), atol=1e-8)


def test_a_users_attitude_controller_commands_the_wheels(flight: FlightParams, memory: FlightMemory) -> None:
    def constant(*_: object) -> jax.Array:
        return jnp.array([1e-3, 2e-3, 3e-3])

    found = control_attitude(Stages(wheel_torque=constant), flight, memory, np.zeros(3), np.float64(0.0))
    np.testing.assert_array_equal(found, [1e-3, 2e-3, 3e-3])
