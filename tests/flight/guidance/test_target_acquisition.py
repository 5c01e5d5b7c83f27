"""Target acquisition: confirmation by several boxes, and fading of the count of detections."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from simulated_guidance import look, plan, push_back

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import (
    attitude_guidance,
)
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate


@pytest.mark.parametrize("dt", [1.0, 5.0])
@pytest.mark.parametrize(
    ("frames", "seen"),
    [("x", False), ("xx", False), ("xxx", True), ("x.x.x", False), ("x.xx", True), ("x" + 19 * "." + "x", False)],
)
def test_three_boxes_in_a_row_acquire_the_target_and_fewer_do_not(
    flight: FlightParams, known: OrbitEstimate, frames: str, seen: bool, dt: float
) -> None:
    state = look(flight, known, frames, dt=dt)
    assert bool(state.acquisition.acquired) is seen
    assert bool(attitude_guidance.is_lost(flight.pointing, state)) is not seen


def test_the_count_of_detections_decays_by_a_fifth_with_every_frame_without_a_box(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    state = look(flight, known, "xxxx..")
    np.testing.assert_allclose(state.acquisition.recent_detections, 4.0 * 0.8**2, rtol=1e-12)
    full = look(flight, known, 15 * "x")
    assert full.acquisition.recent_detections == 10.0
    # From ten sightings on the target is out of sight after the fourteenth empty frame, long before a search begins.
    assert not bool(attitude_guidance.is_lost(flight.pointing, look(flight, known, 13 * ".", full)))
    faded = look(flight, known, 14 * ".", full)
    assert bool(attitude_guidance.is_lost(flight.pointing, faded))
    assert bool(faded.acquisition.acquired)
    assert faded.search_time == 0.0


def test_a_promising_box_holds_the_camera_before_a_search_and_halts_one(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    # The first tick counts as the end of a slew, and the search begins after three seconds without a box.
    assert look(flight, known, "......").search_time > 0.0
    held = look(flight, known, "..?...")
    assert held.search_time == 0.0
    assert not bool(held.acquisition.acquired)
    wide = rendezvous_scene.estimate(flight, v_TS_N=np.zeros(3), position_sigma=5.0)
    searching = look(flight, wide, 15 * ".")
    assert searching.search_time > 5.0
    assert look(flight, wide, "..", searching).search_time == searching.search_time + 2.0
    assert look(flight, wide, "??", searching).search_time == searching.search_time


def test_a_fast_camera_acquires_the_target_in_the_same_time(flight: FlightParams, known: OrbitEstimate) -> None:
    assert not bool(look(flight, known, 12 * "x", dt=0.2).acquisition.acquired)  # 2.4 s
    assert bool(look(flight, known, 13 * "x", dt=0.2).acquisition.acquired)  # 2.6 s
    faded = look(flight, known, 10 * "x" + 10 * ".", dt=0.2)  # two seconds with boxes, two without
    np.testing.assert_allclose(faded.acquisition.recent_detections, 2.0 * 0.8**2, rtol=1e-12)


def test_a_slow_camera_waits_for_three_frames_before_it_searches(flight: FlightParams, known: OrbitEstimate) -> None:
    # The first tick counts as the end of a slew.
    assert look(flight, known, "...", dt=5.0).search_time == 0.0
    assert look(flight, known, "....", dt=5.0).search_time > 0.0
    searching = replace(
        rendezvous_scene.with_acquisition(look(flight, known, ".."), unseen_time=jnp.float64(50.0)),
        search_time=jnp.float64(4.0),
    )
    once = look(flight, known, "x", searching, dt=5.0)
    assert look(flight, known, "..", once, dt=5.0).search_time == 0.0
    assert look(flight, known, "...", once, dt=5.0).search_time > 0.0


def test_a_planned_look_away_keeps_detections_and_unseen_time(flight: FlightParams, known: OrbitEstimate) -> None:
    away = replace(
        jax.tree.map(jnp.asarray, plan(push_back, flight, known)), turn_start=jnp.float64(0.0), cutoff=jnp.float64(1e6)
    )
    before = look(flight, known, "xxxx")
    after = look(flight, known, 20 * ".", before, away)
    assert after.acquisition.recent_detections == before.acquisition.recent_detections == 4.0
    assert after.acquisition.unseen_time == 0.0
