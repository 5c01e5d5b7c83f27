"""Burn decision at a station: which burns are made with and without confidence, and before the target gets dark."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from numpy_reference import IDENTITY, MU, unit
from rendezvous_scene import HILL_RATE, R_SN_N, SUN_BEHIND_EARTH, SUN_OVERHEAD, V_SN_N
from scipy.linalg import expm

from rpojax.core.pytree import replace
from rpojax.flight import computer
from rpojax.flight.control import thruster_allocation
from rpojax.flight.decisions import burn_decision
from rpojax.flight.decisions.motion_prediction import predict_to_burn
from rpojax.flight.flight_records import FlightMemory, FlightParams
from rpojax.flight.guidance import target_pointing
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.stages import Stages

N = np.sqrt(MU / np.linalg.norm(R_SN_N) ** 3)
PERIOD, LEAD = 200.0, 60.0
STATION = np.array([0.0, -30.0, 0.0])
R_HN = np.stack([unit(R_SN_N), unit(V_SN_N), unit(HILL_RATE)])
HILL = np.zeros((6, 6))
HILL[:3, 3:] = np.eye(3)
HILL[3, 0], HILL[3, 4], HILL[4, 3], HILL[5, 2] = 3.0 * N**2, 2.0 * N, -2.0 * N, -(N**2)
SUN_BEHIND = 1.5e11 * unit(np.cos(np.deg2rad(100.0)) * R_HN[0] - np.sin(np.deg2rad(100.0)) * R_HN[1])
"""Position of the Sun behind the servicer and below its horizon [m]: ten minutes later the target is in the dark."""


LAW = Stages(formation_law=lambda own: own, own_memory=lambda: jnp.zeros(3))
"""A law that wants the velocity change of its memory."""


@partial(jax.jit, static_argnums=0)
def planned(
    stages: Stages, flight: FlightParams, memory: FlightMemory, sun_N: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Planned velocity change in N, and whether it is made in the Hill frame at the burn [m/s]."""
    sight = target_pointing.point_at_target(flight.vehicle, memory.orbit, memory.pointing.reference.q_EN, sun_N)
    predicted = predict_to_burn(flight, memory.orbit)
    decision = burn_decision.Decision(time=jnp.zeros(()), memory=memory, predicted=predicted, pointing=sight)
    plan, _ = burn_decision.plan_burn(rendezvous_scene.software(flight, stages), decision)
    made_H = jnp.sum(predicted.R_CN * plan.delta_v_N[None], axis=1)
    return plan.delta_v_N, jnp.where(plan.cutoff > plan.ignition, made_H, 0.0)


@jax.jit
def start(flight: FlightParams, orbit: OrbitEstimate) -> FlightMemory:
    return computer.initial(rendezvous_scene.software(flight), orbit, jnp.asarray(IDENTITY), jnp.zeros(3))


@pytest.fixture(scope="module")
def memory(flight: FlightParams) -> FlightMemory:
    """Memory with the target acquired and well known."""
    known = rendezvous_scene.estimate(flight, position_sigma=0.05, velocity_sigma=1e-5)
    first = start(flight, known)
    pointing = rendezvous_scene.with_acquisition(
        first.pointing, acquired=jnp.asarray(True), recent_detections=jnp.float64(5.0)
    )
    return replace(first, pointing=pointing)


@pytest.fixture(scope="module")
def exact(flight: FlightParams) -> FlightParams:
    """Flight software that makes the smallest burns, too."""
    return replace(
        flight,
        formation=replace(flight.formation, dead_band=jnp.float64(1e-9)),
        vehicle=replace(flight.vehicle, minimum_on_time=jnp.float64(1e-9)),
    )


def at(
    memory: FlightMemory,
    flight: FlightParams,
    state_H: np.ndarray,
    last_range: float | None = None,
    sigmas: tuple[float, float] = (0.05, 1e-5),
) -> FlightMemory:
    """Memory with an estimate of the relative state, without confidence since the range was `last_range` [m]."""
    r_TS_N, rate_H = -R_HN.T @ state_H[:3], state_H[3:]
    v_TS_N = -R_HN.T @ rate_H + np.cross(HILL_RATE, r_TS_N)
    orbit = rendezvous_scene.estimate(flight, r_TS_N, v_TS_N, *sigmas)
    health = memory.health
    if last_range is not None:
        health = replace(health, confident=jnp.asarray(False), confident_range=jnp.float64(last_range))
    return replace(memory, orbit=orbit, health=health)


def change(
    memory: FlightMemory,
    flight: FlightParams,
    state_H: np.ndarray,
    wanted: np.ndarray | None = None,
    last_range: float | None = None,
    sun_N: np.ndarray = SUN_OVERHEAD,
) -> np.ndarray:
    """Velocity change [m/s] for a state a `LEAD` before the burn, by the packaged law or one for what is `wanted`."""
    now = at(memory, flight, state_H, last_range)
    if wanted is None:
        return np.asarray(planned(Stages(), flight, now, jnp.asarray(sun_N))[1])
    return np.asarray(planned(LAW, flight, replace(now, own=jnp.asarray(wanted)), jnp.asarray(sun_N))[1])


def before_burn(state_H: np.ndarray) -> np.ndarray:
    """State a `LEAD` before the one at the burn."""
    return expm(-HILL * LEAD) @ state_H


def least_range(state_H: np.ndarray, duration: float = 2.0 * PERIOD) -> float:
    """Least range over free motion, by the matrix exponential of Hill's equations [m]."""
    return min(float(np.linalg.norm((expm(HILL * t) @ state_H)[:3])) for t in np.linspace(duration / 24, duration, 24))


@pytest.mark.parametrize("toward", [0.02, 0.06])
def test_a_burn_is_made_as_far_as_its_free_motion_stays_outside_of_half_of_the_distance(
    exact: FlightParams, memory: FlightMemory, toward: float
) -> None:
    state = np.concatenate([STATION, np.zeros(3)])
    wanted = np.array([0.0, toward, 0.0])
    found = change(memory, exact, before_burn(state), wanted)
    after = [least_range(np.concatenate([STATION, burn])) for burn in (wanted, found)]
    if toward < 0.03:
        np.testing.assert_allclose(found, wanted, atol=1e-6)
    else:
        assert after[0] < 15.0 < after[1]


def test_a_servicer_that_drifts_into_the_zone_leaves_it(exact: FlightParams, memory: FlightMemory) -> None:
    state = np.array([0.0, -20.0, 0.0, 0.0, 0.08, 0.0])
    found = change(memory, exact, before_burn(state), np.array([0.0, 0.02, 0.0]))
    assert least_range(state) < 6.0
    assert least_range(state + np.concatenate([np.zeros(3), found])) > 11.9  # one burn can do no more


@pytest.mark.parametrize("sigmas", [(1.0, 1e-4), (0.3, 5e-3)])
@pytest.mark.parametrize("distance", [14.9, 15.5, 17.0, 18.0])
def test_a_servicer_near_the_border_of_its_zone_can_leave(
    exact: FlightParams, memory: FlightMemory, distance: float, sigmas: tuple[float, float]
) -> None:
    """Its range or its velocity are known so little that it may come to either side of 15 m."""
    now = at(memory, exact, before_burn(np.array([0.0, -distance, 0.0, 0.0, 0.0, 0.0])), sigmas=sigmas)
    found = np.asarray(planned(Stages(), exact, now, jnp.asarray(SUN_OVERHEAD))[1])
    assert found[1] < -2e-3


def simulated_ranges(
    memory: FlightMemory, flight: FlightParams, state: np.ndarray, scale: float = 1.0, last_range: float | None = None
) -> np.ndarray:
    """Ranges at 60 burns of the packaged law, for an estimate that is the true state times a factor [m]."""
    ranges = []
    for _ in range(60):
        burn = change(memory, flight, scale * state, last_range=last_range)
        state = expm(HILL * LEAD) @ state + np.concatenate([np.zeros(3), burn])
        ranges.append(least_range(state, PERIOD))
        state = expm(HILL * (PERIOD - LEAD)) @ state
    return np.array(ranges)


@pytest.mark.parametrize("begin", [45.0, 25.0, 12.0])
def test_burns_towards_a_station_behind_the_target_do_not_add_up_to_an_approach(
    exact: FlightParams, memory: FlightMemory, begin: float
) -> None:
    ranges = simulated_ranges(memory, exact, np.array([0.0, begin, 0.0, 0.0, 0.0, 0.0]))
    assert np.min(ranges) > min(begin, 15.0) - 0.5


def test_a_station_twice_as_far_is_reached_although_the_servicer_begins_within_its_zone(
    exact: FlightParams, memory: FlightMemory
) -> None:
    far = replace(exact, formation=replace(exact.formation, desired_position=jnp.array([0.0, -100.0, 0.0])))
    ranges = simulated_ranges(memory, far, np.array([2.0, -48.0, 1.0, 0.0, 0.01, 0.0]))
    assert np.min(ranges) > 40.0
    assert np.all(np.abs(ranges[-5:] - 100.0) < 5.0)


@pytest.mark.parametrize("scale", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("x", [-6.0, 0.0, 6.0])
def test_without_confidence_the_servicer_holds_even_if_the_range_is_believed_far_from_what_it_is(
    exact: FlightParams, memory: FlightMemory, scale: float, x: float
) -> None:
    state = np.array([x, -50.0, 2.0, 0.005, -0.01, 0.005])
    begin = float(np.linalg.norm(state[:3]))
    ranges = simulated_ranges(memory, exact, state, scale, last_range=scale * begin)
    assert min(ranges) > begin
    assert max(ranges) < 1.2 * begin
    assert np.all((ranges[-10:] > 1.08 * begin) & (ranges[-10:] < 1.15 * begin))


def test_without_confidence_a_hold_does_not_return_to_the_range_at_which_it_was_lost(
    exact: FlightParams, memory: FlightMemory
) -> None:
    far = np.array([0.0, -80.0, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(change(memory, exact, far, last_range=50.0), 0.0, atol=1e-5)


@pytest.mark.parametrize("sigmas", [(0.05, 1e-5), (0.5, 2e-3)])
@pytest.mark.parametrize("last_range", [None, 25.0])
@pytest.mark.parametrize(
    "state",
    [(3.0, -35.0, 1.0, 0.01, 0.02, -0.005), (0.0, -30.0, 0.0, 0.0, 0.0, 0.0), (0.0, -30.0, 0.0, 0.0, -0.02, 0.0)],
)
def test_the_last_burns_in_the_light_stop_the_drift(
    exact: FlightParams,
    memory: FlightMemory,
    state: tuple[float, ...],
    last_range: float | None,
    sigmas: tuple[float, float],
) -> None:
    now = replace(at(memory, exact, before_burn(np.array(state)), last_range, sigmas), own=jnp.array([0.0, 0.01, 0.0]))
    found = np.asarray(planned(LAW, exact, now, jnp.asarray(SUN_BEHIND))[1])
    after = np.array(state) + np.concatenate([np.zeros(3), found])
    np.testing.assert_allclose(after[3:], [0.0, -2.0 * N * state[0], 0.0], atol=4e-6)
    assert least_range(after, 2.0 * np.pi / N) > 25.0


def test_handed_over_in_the_dark_it_leaves_a_drift_that_may_lead_into_the_zone(
    exact: FlightParams, memory: FlightMemory
) -> None:
    state, sigmas = np.array([0.0, -50.0, 0.0, 0.0, -0.003, 0.0]), (0.5, 0.001)
    blind = at(memory, exact, before_burn(state), sigmas=sigmas)
    found = np.asarray(planned(Stages(), exact, blind, jnp.asarray(SUN_BEHIND_EARTH))[1])
    errors = np.random.default_rng(3).normal(size=(200, 6)) * np.repeat(sigmas, 3)

    def share_inside(burn: np.ndarray) -> float:
        after = state + errors + np.concatenate([np.zeros(3), burn])
        return float(np.mean([least_range(each, 2.0 * np.pi / N) < 10.0 for each in after]))

    assert share_inside(np.zeros(3)) > 0.3
    assert share_inside(found) < 0.01
    # What has been seen before it got dark has been stopped.
    seen = replace(blind, gate=replace(blind.gate, supported_age=jnp.float64(100.0)))
    np.testing.assert_array_equal(planned(Stages(), exact, seen, jnp.asarray(SUN_BEHIND_EARTH))[1], 0.0)


@jax.jit
def planned_in_row(flight: FlightParams, memory: FlightMemory, row: jax.Array) -> jax.Array:
    """Velocity change [m/s] before darkness in a row of a mission: 0 a transfer, 1 the built-in hold, 2 aborted."""
    software = rendezvous_scene.software(flight, LAW)
    phase = dataclasses.replace(software.mission.phases[0], stops_in_the_dark=False)
    mission = dataclasses.replace(software.mission, phases=(phase,), is_managed=True)
    software = dataclasses.replace(software, mission=mission)
    memory = replace(
        memory, mission=replace(memory.mission, phase=row.astype(jnp.int32)), phase_gains=3 * memory.phase_gains
    )
    sun_N = jnp.asarray(SUN_BEHIND)
    sight = target_pointing.point_at_target(flight.vehicle, memory.orbit, memory.pointing.reference.q_EN, sun_N)
    predicted = predict_to_burn(flight, memory.orbit)
    decision = burn_decision.Decision(time=jnp.zeros(()), memory=memory, predicted=predicted, pointing=sight)
    plan, _ = burn_decision.plan_burn(software, decision)
    return jnp.where(plan.cutoff > plan.ignition, jnp.sum(predicted.R_CN * plan.delta_v_N[None], axis=1), 0.0)


def test_a_held_place_stops_before_darkness_and_an_abort_stays_one(exact: FlightParams, memory: FlightMemory) -> None:
    moving = np.array([0.0, -30.0, 0.0, 0.0, -0.01, 0.0])
    now = replace(at(memory, exact, before_burn(moving), sigmas=(0.1, 1e-4)), own=jnp.array([0.0, 2e-3, 0.0]))
    transfer, held = (np.asarray(planned_in_row(exact, now, jnp.asarray(row))) for row in (0, 1))
    np.testing.assert_allclose(held, [0.0, 0.01, 0.0], atol=4e-6)
    assert np.abs(transfer - held).max() > 1e-3
    at_rest = np.array([0.0, -30.0, 0.0, 0.0, 0.0, 0.0])
    now = replace(at(memory, exact, before_burn(at_rest), sigmas=(0.3, 1e-3)), own=jnp.zeros(3))
    # By the estimate alone it could stay, but not with its uncertainty over a day.
    assert np.linalg.norm(planned_in_row(exact, now, jnp.asarray(2))) > 1e-3


@pytest.mark.parametrize(("open_s", "is_made"), [(10.0, True), (4.0, False)])
@pytest.mark.parametrize("translates", [True, False])
def test_a_burn_is_made_by_what_the_force_of_its_thrusters_gives(
    exact: FlightParams, memory: FlightMemory, translates: bool, open_s: float, is_made: bool
) -> None:
    """Those of the reaction control system in a mission that translates by them, else the one thruster."""
    wrench = np.concatenate([np.eye(6), -np.eye(6)], axis=1)
    thrusters = thruster_allocation.layout(wrench, np.ones(12), np.zeros(12))
    software = rendezvous_scene.software(replace(exact, thrusters=thrusters))
    phases = tuple(dataclasses.replace(each, translates=translates) for each in software.mission.phases)
    software = dataclasses.replace(software, mission=dataclasses.replace(software.mission, phases=phases))
    force = thrusters.authority if translates else exact.vehicle.thrust
    burn_N = jnp.array([0.0, 10.0, 0.0]) * force / exact.vehicle.mass
    plan = replace(memory.plan, ignition=jnp.asarray(5.0), cutoff=jnp.asarray(5.0 + open_s), delta_v_N=burn_N)
    after = replace(memory, plan=plan)
    assert bool(burn_decision._is_made(software, after, jnp.asarray(100.0))) is is_made
