"""Phases of a team on one relative orbit: spread anew without a lost servicer, and chosen for what is newly seen."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.pytree import replace
from rpojax.flight.guidance import burn_schedule
from rpojax.flight.mission import team_mission_state
from rpojax.flight.team_guidance import direction_map, intent, phase_assignment, viewpoint_assignment
from rpojax.flight.team_guidance.team_situation import TeamSituation, TeamTuning, least_angle
from rpojax.scenario.sections import TeamSection

TUNING = TeamTuning(
    keep_out=jnp.float64(10.0),
    lost_after=jnp.float64(60.0),
    phase_rate=jnp.float64(np.deg2rad(60.0) / 3600.0),
    view_incidence=jnp.float64(np.deg2rad(60.0)),
    view_sun_incidence=jnp.float64(np.deg2rad(90.0)),
    view_memory=jnp.float64(6000.0),
    keeping_delta_v=jnp.float64(0.005),
)
RADIAL, CROSS_TRACK, N = 18.0, 22.0, 1.1e-3
spread = jax.jit(phase_assignment.spread)
assign = jax.jit(viewpoint_assignment.assign)
seen_from = jax.jit(viewpoint_assignment._seen)


def team(
    number: int, slots_deg: list[float], lost: set[int] = frozenset(), shifts_deg: list[float] | None = None
) -> TeamSituation:
    """A team as a servicer knows it, in which some are lost; all are where the plan and their shifts want them."""
    count = len(slots_deg)
    slots, shifts = np.deg2rad(slots_deg), np.deg2rad(shifts_deg or [0.0] * count)
    return TeamSituation(
        own=jnp.asarray(np.arange(count) == number),
        present=jnp.asarray(np.array([k not in lost for k in range(count)])),
        slots=jnp.asarray(slots),
        shifts=jnp.asarray(shifts),
        shift_left=jnp.float64(0.0),
        present_before=jnp.asarray(np.ones(count, dtype=bool)),
        believed=jnp.asarray(slots + shifts),
        radial=jnp.float64(RADIAL),
        cross_track=jnp.float64(CROSS_TRACK),
        cross_track_lead=jnp.float64(0.0),
        clearance=jnp.float64(12.0),
        argument_of_latitude=jnp.float64(0.4),
        mean_motion=jnp.float64(N),
        sun_H=jnp.array([0.0, 0.0, 1.0]),
        time=jnp.float64(1000.0),
        last_seen=direction_map.unseen(jnp.float64(0.0)),
    )


def phases_deg(slots_deg: list[float], lost: set[int]) -> dict[int, float]:
    """Phases [deg] that those who are left choose, each for itself."""
    left = [k for k in range(len(slots_deg)) if k not in lost]
    return {k: float((slots_deg[k] + np.rad2deg(spread(team(k, slots_deg, lost)))) % 360.0) for k in left}


def test_a_whole_team_keeps_to_the_plan() -> None:
    assert all(float(spread(team(k, [0.0, 90.0, 180.0]))) == 0.0 for k in range(3))


def test_neighbours_that_are_left_stay_where_they_are() -> None:
    assert phases_deg([0.0, 90.0, 180.0], {2}) == pytest.approx({0: 0.0, 1: 90.0})
    assert phases_deg([0.0, 90.0, 180.0], {0}) == pytest.approx({1: 90.0, 2: 180.0})


def test_without_the_middle_one_the_others_come_to_the_planned_angle_and_not_past_it() -> None:
    found = phases_deg([0.0, 90.0, 180.0], {1})
    apart = (found[2] - found[0]) % 360.0
    assert min(apart, 360.0 - apart) == pytest.approx(90.0)
    # Both move by 45 deg, away from the lost one, which may still be where it was.
    assert found == pytest.approx({0: 315.0, 2: 225.0})


@pytest.mark.parametrize("lost", [{0}, {1}, {2}, {3}, {4}, {1, 2}, {0, 3}])
def test_all_who_are_left_choose_phases_that_are_as_far_apart_as_planned(lost: set[int]) -> None:
    found = sorted(phases_deg([0.0, 60.0, 120.0, 180.0, 240.0], lost).values())
    gaps = np.diff([*found, found[0] + 360.0])
    assert gaps.min() == pytest.approx(60.0)


def test_the_least_angle_keeps_the_relative_orbits_apart() -> None:
    angle = float(jax.jit(least_angle)(team(0, [0.0, 90.0])))
    u = np.linspace(0.0, 2.0 * np.pi, 2000)

    def place(phase: float) -> np.ndarray:
        c, s = np.cos(u - phase), np.sin(u - phase)
        return np.stack([-RADIAL * c, 2.0 * RADIAL * s, CROSS_TRACK * s])

    # Any offset along the track may add to it, so that only height and distance across the plane count.
    difference = (place(angle) - place(0.0))[[0, 2]]
    assert np.linalg.norm(difference, axis=0).min() == pytest.approx(12.0, rel=1e-4)


def test_a_shift_goes_to_its_end_at_the_rate_and_stays_there() -> None:
    record = team_mission_state.initial(jnp.float64(0.0), TUNING.phase_rate, 3)
    record = team_mission_state.shifted(record, jnp.float64(-0.5), jnp.array([True, True, False]), jnp.float64(100.0))
    rate = float(TUNING.phase_rate)
    assert float(team_mission_state.angle(record, jnp.float64(50.0))) == 0.0
    assert float(team_mission_state.angle(record, jnp.float64(600.0))) == pytest.approx(-500.0 * rate)
    assert float(team_mission_state.angle(record, jnp.float64(1e6))) == -0.5
    record = team_mission_state.shifted(record, jnp.float64(0.0), jnp.ones(3, dtype=bool), jnp.float64(600.0))
    assert float(team_mission_state.angle(record, jnp.float64(700.0))) == pytest.approx(-400.0 * rate)


def test_a_servicer_under_way_arrives_first_unless_another_one_has_left_or_taken_its_place() -> None:
    under_way = replace(team(0, [0.0, 120.0, 240.0], {2}, [30.0, 0.0, 0.0]), shift_left=jnp.float64(0.2))
    # Where it goes to, nothing is new any more.
    seen = np.asarray(seen_from(TUNING, under_way, np.deg2rad([30.0])))[:, 0]
    under_way = replace(under_way, last_seen=jnp.asarray(np.where(seen, under_way.time, under_way.last_seen)))
    chosen = {
        name: float(assign(TUNING, replace(under_way, present_before=jnp.array(before))))
        for name, before in (("same", [True, True, False]), ("left", [True] * 3), ("other", [True, False, True]))
    }
    assert chosen["same"] == pytest.approx(np.deg2rad(30.0))
    assert chosen["left"] == chosen["other"] != pytest.approx(np.deg2rad(30.0))
    arrived = replace(under_way, present_before=under_way.present, shift_left=jnp.float64(0.0))
    assert float(assign(TUNING, arrived)) == chosen["left"]


def test_a_viewpoint_is_chosen_for_what_it_newly_sees_per_delta_v() -> None:
    situation = team(0, [0.0])
    unaware = float(assign(TUNING, situation))
    # Nothing was seen before: staying costs least.
    assert unaware == 0.0
    # Everything that is seen without a shift, and by steps of 30 deg, was seen just now.
    seen = np.asarray(seen_from(TUNING, situation, np.deg2rad([0.0, 30.0, -30.0, -60.0])))
    last_seen = np.where(np.any(seen, axis=1), situation.time, situation.last_seen)
    found = float(assign(TUNING, replace(situation, last_seen=last_seen)))
    gains = {
        step: float(np.sum(np.asarray(seen_from(TUNING, situation, np.array([step])))[:, 0] & ~np.any(seen, axis=1)))
        / (0.005 + N * 2.0 * np.sin(abs(step) / 2.0) * (0.5 * RADIAL + CROSS_TRACK))
        for step in np.deg2rad([0.0, -30.0, 30.0, -60.0, 60.0, -90.0, 90.0])
    }
    assert found == pytest.approx(max(gains, key=gains.__getitem__))
    assert found != 0.0


def test_what_is_new_where_a_servicer_is_keeps_it_there() -> None:
    """By the packaged delta-v of keeping a phase; more than that would send it away for little."""
    tuning = replace(TUNING, keeping_delta_v=jnp.float64(TeamSection().keeping_delta_v_m_s))
    situation = team(0, [0.0])
    here = np.asarray(seen_from(tuning, situation, np.array([0.0])))[:, 0]
    # Of what it sees without a shift one side is new, and of what other phases show, all that it does not see.
    new = ~here | (np.cumsum(here) <= 1)
    situation = replace(situation, last_seen=np.where(new, situation.last_seen, situation.time))
    assert float(assign(tuning, situation)) == 0.0
    assert float(assign(replace(tuning, keeping_delta_v=jnp.float64(0.005)), situation)) != 0.0


def test_viewpoints_of_a_team_stay_apart() -> None:
    situation = team(1, [0.0, 60.0, 120.0])
    seen = np.asarray(seen_from(TUNING, situation, situation.slots))
    last_seen = np.where(np.any(seen, axis=1), situation.time, situation.last_seen)
    found = [
        slot + float(assign(TUNING, replace(team(k, [0.0, 60.0, 120.0]), last_seen=last_seen)))
        for k, slot in enumerate(np.deg2rad([0.0, 60.0, 120.0]))
    ]
    gaps = np.rad2deg(np.diff(sorted(found)))
    assert gaps.min() >= 45.0 - 1e-9


def test_what_is_left_of_a_burn_is_told() -> None:
    plan = replace(
        burn_schedule.no_burn(),
        ignition=jnp.float64(50.0),
        cutoff=jnp.float64(60.0),
        delta_v_N=jnp.array([1.0, 0.0, -2.0]),
    )
    yes = jnp.asarray(True)
    told = {t: intent.intent(plan, yes, jnp.float64(0.0), yes, jnp.float64(t)) for t in (10.0, 55.0, 70.0)}
    np.testing.assert_allclose(told[10.0].delta_v_N, [1.0, 0.0, -2.0])
    assert float(told[10.0].burn_time) == 55.0
    np.testing.assert_allclose(told[55.0].delta_v_N, [0.5, 0.0, -1.0])
    assert float(told[55.0].burn_time) == 57.5
    np.testing.assert_array_equal(told[70.0].delta_v_N, np.zeros(3))
    nothing = intent.intent(burn_schedule.no_burn(), yes, jnp.float64(0.0), yes, jnp.float64(0.0))
    np.testing.assert_array_equal(nothing.delta_v_N, np.zeros(3))
