"""Attitude guidance: pointing schedule around a burn, loss of the target, search and darkness."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from numpy_reference import (
    attitude_difference,
    unit,
)
from simulated_guidance import (
    NO,
    SAMPLES,
    TIME,
    YES,
    boresight,
    look,
    plan,
    push_back,
    push_gently,
    push_hard,
    simulate,
    simulate_search,
)

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import attitude_guidance, burn_schedule
from rpojax.flight.guidance.burn_schedule import BurnPlan
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate

EXACT = 1e-12  # roundings of unit vectors and angles


def simulate_plan(
    flight: FlightParams, known: OrbitEstimate, found: BurnPlan
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, modes and commanded attitudes (ticks, samples, 4) around a planned burn, starting on the target."""
    times = TIME + np.arange(300.0)
    state = attitude_guidance.initial_pointing(flight.vehicle, known)
    modes, commands, _ = simulate(flight, known, found, state, times, np.asarray(False))
    return times, np.asarray(modes), np.asarray(commands.q_CN)


@pytest.mark.parametrize("law", [push_back, push_hard], ids=["usual", "too long"])
def test_the_pointing_schedule_of_a_burn_is_within_the_look_away_limit(
    flight: FlightParams, known: OrbitEstimate, law: object
) -> None:
    found = plan(law, flight, known)
    times, modes, attitudes = simulate_plan(flight, known, found)
    sequence = [Mode(mode) for mode, _ in itertools.groupby(modes)]
    assert sequence == [Mode.LOOK, Mode.TURN, Mode.BURN, Mode.TURN_BACK, Mode.LOOK]
    away = times[(modes != Mode.LOOK)]
    assert away[-1] + 1.0 - away[0] <= 110.0
    burning = (times >= found.ignition) & (times < found.cutoff)
    for q_CN in attitudes[burning].reshape(-1, 4):
        assert attitude_difference(q_CN, found.q_burn) < EXACT
    line = unit(rendezvous_scene.TARGET_AHEAD)
    assert boresight(flight, attitudes[-1, -1]) @ line > np.cos(np.deg2rad(0.1))
    assert found.cutoff - found.ignition > 5.0


def test_the_commanded_attitude_is_continuous_during_the_schedule(flight: FlightParams, known: OrbitEstimate) -> None:
    _, _, attitudes = simulate_plan(flight, known, plan(push_back, flight, known))
    flat = attitudes.reshape(-1, 4)
    steps = np.array([attitude_difference(q, p) for q, p in itertools.pairwise(flat)])
    peak = np.sqrt(2.0 * np.pi * 0.016 / np.pi)  # rad/s, twice the mean rate of the longest slew, half a turn
    assert steps.max() < peak / SAMPLES * 1.01


def test_without_a_burn_the_camera_stays_on_the_target(flight: FlightParams, known: OrbitEstimate) -> None:
    found = plan(push_gently, flight, known)
    _, modes, attitudes = simulate_plan(flight, known, found)
    assert set(modes.tolist()) == {Mode.LOOK}
    off = [boresight(flight, q) @ unit(rendezvous_scene.TARGET_AHEAD) for q in attitudes.reshape(-1, 4)]
    assert min(off) > np.cos(np.deg2rad(0.1))


def test_the_search_starts_after_the_wait_before_and_after_acquisition(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    # The first tick counts as the end of a slew, so a search begins one tick after the wait is over.
    modes, _ = simulate_search(flight, 3.0, 300)
    assert modes[:10].tolist() == [Mode.LOOK] * 4 + [Mode.SEARCH] * 6
    acquired = rendezvous_scene.with_acquisition(
        attitude_guidance.initial_pointing(flight.vehicle, known), acquired=jnp.asarray(True)
    )
    times = TIME + np.arange(300.0)
    later, _, _ = simulate(flight, known, burn_schedule.no_burn(), acquired, times, np.asarray(True))
    assert np.asarray(later)[:70].tolist() == [Mode.LOOK] * 61 + [Mode.SEARCH] * 9


def test_a_search_ends_when_the_target_is_seen(flight: FlightParams, known: OrbitEstimate) -> None:
    state = attitude_guidance.initial_pointing(flight.vehicle, known)
    searching = replace(
        rendezvous_scene.with_acquisition(state, unseen_time=jnp.float64(99.0)), search_time=jnp.float64(4.0)
    )
    modes, _, accepted = simulate(
        flight, known, burn_schedule.no_burn(), searching, TIME + np.arange(300.0), np.asarray(False)
    )
    assert accepted[0]
    assert np.all(np.asarray(modes) == Mode.LOOK)


def test_the_target_is_lost_before_acquisition_and_after_a_minute_unseen(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    state = attitude_guidance.initial_pointing(flight.vehicle, known)
    assert bool(attitude_guidance.is_lost(flight.pointing, state))
    acquired = rendezvous_scene.with_acquisition(state, acquired=jnp.asarray(True), recent_detections=jnp.float64(3.0))
    assert not bool(attitude_guidance.is_lost(flight.pointing, acquired))
    unseen = rendezvous_scene.with_acquisition(acquired, unseen_time=jnp.float64(60.5))
    assert bool(attitude_guidance.is_lost(flight.pointing, unseen))


def test_a_single_box_keeps_the_camera_from_searching_for_five_seconds(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    searching = replace(
        rendezvous_scene.with_acquisition(look(flight, known, ".."), unseen_time=jnp.float64(50.0)),
        search_time=jnp.float64(4.0),
    )
    once = look(flight, known, "x", searching)
    assert once.search_time == 0.0
    assert look(flight, known, 5 * ".", once).search_time == 0.0
    assert look(flight, known, 6 * ".", once).search_time > 0.0


def test_darkness_prevents_a_search_and_resets_the_acquisition(flight: FlightParams, known: OrbitEstimate) -> None:
    seen = look(flight, known, 5 * "x")
    assert bool(seen.acquisition.acquired)
    dark = look(flight, known, ".", seen, visible=NO)
    assert (
        float(dark.acquisition.recent_detections),
        float(dark.acquisition.unseen_time),
        bool(dark.acquisition.acquired),
    ) == (0.0, 0.0, False)
    state = attitude_guidance.initial_pointing(flight.vehicle, known)
    times = TIME + np.arange(300.0)
    modes, commands, _ = simulate(flight, known, burn_schedule.no_burn(), state, times, YES, NO)
    assert set(np.asarray(modes).tolist()) == {Mode.LOOK}
    off = [boresight(flight, q) @ unit(rendezvous_scene.TARGET_AHEAD) for q in np.asarray(commands.q_CN)[:, 0]]
    assert min(off) > np.cos(np.deg2rad(0.1))
    # The first light: a search only after the wait for acquisition.
    assert look(flight, known, "...", dark).search_time == 0.0
    assert look(flight, known, "....", dark).search_time > 0.0


def test_a_search_ends_at_sunset(flight: FlightParams, known: OrbitEstimate) -> None:
    searching = look(flight, known, 30 * ".")
    assert searching.search_time > 0.0
    dark = look(flight, known, ".", searching, visible=NO)
    assert (float(dark.search_time), float(dark.acquisition.unseen_time)) == (0.0, 0.0)


def test_the_slew_back_from_an_inhibited_burn_is_no_search(flight: FlightParams, known: OrbitEstimate) -> None:
    found = plan(push_back, flight, known)
    off = replace(found, cutoff=found.ignition)
    _, modes, _ = simulate_plan(flight, known, off)
    sequence = [Mode(mode) for mode, _ in itertools.groupby(modes)]
    assert sequence == [Mode.LOOK, Mode.TURN, Mode.TURN_BACK, Mode.LOOK]
