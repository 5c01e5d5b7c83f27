"""Transitions of the mission manager: conditions, timeouts, commands and aborts."""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import replace
from rpojax.flight.guidance.references.hold import Hold
from rpojax.flight.guidance.references.phase_entry import PhaseEntry
from rpojax.flight.mission import mission_manager, mission_state
from rpojax.flight.mission.mission_manager import Situation
from rpojax.flight.mission.mission_state import AbortReason, Condition, MissionState, Transition
from rpojax.flight.mission.phase_table import Corridor, MissionTuning, Phase, Until
from rpojax.flight.mission.static_mission_settings import MissionSettings, PhaseSettings, TimeoutAction

HOLD, ABORTED = 3, 4
PLACE = np.array([0.0, -60.0, 0.0, 0.0, 0.0, 0.0])
ALWAYS = Until(
    time=jnp.float64(0.0),
    arrival_box=jnp.full(3, jnp.inf),
    arrival_for=jnp.float64(0.0),
    range_sigma=jnp.float64(jnp.inf),
    range_sigma_for=jnp.float64(0.0),
    ground_go=jnp.float64(0.0),
    attitude_sigma=jnp.float64(jnp.inf),
    attitude_sigma_for=jnp.float64(0.0),
)


def settings(on_timeout: TimeoutAction = "hold", passively_safe: bool = False) -> MissionSettings:
    """Three phases, of which the first has a corridor."""

    def phase(name: str) -> PhaseSettings:
        return PhaseSettings(
            name=name,
            pointing="target",
            control_ticks=200,
            burns_per_orbit=1,
            on_timeout=on_timeout,
            ends=True,
            has_arrival_box=True,
            passively_safe=passively_safe,
            has_corridor=name == "first",
            stops_in_the_dark=True,
        )

    return MissionSettings(
        phases=(phase("first"), phase("second"), phase("last")),
        is_managed=True,
        decision_ticks=20,
        hold_ticks=200,
        hold_burns_per_orbit=1,
    )


def tuning(until: Until, timeout: float = np.inf, **commands: float) -> MissionTuning:
    """The three phases with equal ends."""
    corridor = Corridor(axis=jnp.array([0.0, -2.0, 0.0]), half_angle=jnp.deg2rad(10.0), width=jnp.float64(1.0))

    def phase(corridor: Corridor | None) -> Phase:
        return Phase(
            reference=Hold(position=jnp.asarray(PLACE[:3])),
            position_weight=jnp.ones(3),
            velocity_weight=jnp.zeros(3),
            delta_v_weight=jnp.ones(3),
            until=until,
            timeout=jnp.float64(timeout),
            keep_out=jnp.full(3, 10.0),
            corridor=corridor,
        )

    numbers = {"hold_at": 1e9, "resume_at": 1e9, "abort_at": 1e9} | commands
    return MissionTuning(
        phases={"first": phase(corridor), "second": phase(None), "last": phase(None)},
        keep_out=jnp.full(3, 10.0),
        abort_horizon=jnp.float64(86400.0),
        abort_sigmas=jnp.float64(3.0),
        abort_margin=jnp.float64(2.0),
        **{name: jnp.float64(value) for name, value in numbers.items()},
    )


def orbit(u: float) -> TargetOrbit:
    zero = jnp.float64(0.0)
    return TargetOrbit(argument_of_latitude=jnp.float64(u), ex=zero, ey=zero, semi_major_axis=jnp.float64(7e6))


def situation(time: float, **changes: Any) -> Situation:
    """On the station, and all is well."""
    found = Situation(
        time=jnp.float64(time),
        state_H=jnp.asarray(PLACE),
        burn_time=jnp.float64(time + 60.0),
        burn_state_H=jnp.asarray(PLACE) + 1.0,
        burn_orbit=orbit(0.4),
        burn_pending=jnp.asarray(False),
        place=jnp.asarray(changes.get("state_H", PLACE))[:3],
        end=jnp.asarray(PLACE[:3]),
        state_T=None,
        attitude_sigma=jnp.float64(jnp.inf),
        can_follow=jnp.asarray(True),
        may_follow=jnp.asarray(True),
        range_sigma=jnp.float64(1.0),
        seen=jnp.asarray(True),
        lost=jnp.asarray(False),
        confident=jnp.asarray(True),
        thruster_works=jnp.asarray(True),
        enters_keep_out=jnp.asarray(False),
    )
    return replace(found, **{name: jnp.asarray(value) for name, value in changes.items()})


def start(phase: int = 0, seen: bool = True) -> MissionState:
    begun = mission_state.initial(PhaseEntry(relative_state=jnp.asarray(PLACE), orbit=orbit(0.3)), jnp.float64(60.0))
    return replace(begun, phase=jnp.int32(phase), has_seen_target=jnp.asarray(seen))


def after(
    until: Until, *situations: Situation, static: MissionSettings | None = None, **numbers: float
) -> MissionState:
    """State after some decisions."""
    state = start()
    for each in situations:
        state = mission_manager.update(static or settings(), tuning(until, **numbers), state, each)
    return state


def test_a_phase_ends_after_its_time_and_the_next_begins_with_the_state_at_its_first_burn() -> None:
    until = replace(ALWAYS, time=jnp.float64(100.0))
    assert after(until, situation(99.0)).phase == 0
    found = after(until, situation(100.0))
    assert (found.phase, found.entered_at, found.starts_at) == (1, 100.0, 160.0)
    np.testing.assert_array_equal(found.entry.relative_state, PLACE + 1.0)
    assert found.entry.orbit.argument_of_latitude == 0.4
    later = mission_manager.update(settings(), tuning(until), found, situation(120.0, burn_state_H=PLACE))
    np.testing.assert_array_equal(later.entry.relative_state, PLACE + 1.0)


def test_the_last_phase_does_not_end() -> None:
    state = after(ALWAYS, *(situation(20.0 * number) for number in range(6)))
    assert (state.phase, state.entered_at) == (2, 20.0)


def test_arrival_takes_an_uninterrupted_stay_in_the_box() -> None:
    until = replace(ALWAYS, arrival_box=jnp.full(3, 2.0), arrival_for=jnp.float64(40.0))
    outside = jnp.asarray(PLACE).at[2].add(2.1)
    stay = [situation(20.0 * number) for number in range(3)]
    assert after(until, *stay).phase == 1
    assert after(until, *stay[:2], situation(30.0, state_H=outside), situation(40.0), situation(60.0)).phase == 0


def test_all_conditions_must_hold() -> None:
    until = replace(
        ALWAYS, range_sigma=jnp.float64(0.5), range_sigma_for=jnp.float64(20.0), ground_go=jnp.float64(50.0)
    )
    known = [situation(time, range_sigma=0.4) for time in (0.0, 20.0, 40.0)]
    assert after(until, *known).phase == 0
    assert after(until, *known, situation(60.0, range_sigma=0.4)).phase == 1
    assert after(until, *known, situation(60.0)).phase == 0


@pytest.mark.parametrize(("action", "row"), [("next", 1), ("hold", HOLD), ("abort", ABORTED)])
def test_a_timeout_has_the_consequence_that_is_asked_for(action: TimeoutAction, row: int) -> None:
    never = replace(ALWAYS, time=jnp.float64(1e6))
    found = after(never, situation(300.0), static=settings(action), timeout=300.0)
    assert found.phase == row
    assert found.abort_reason == (AbortReason.TIMEOUT if action == "abort" else AbortReason.NONE)


def test_a_command_holds_and_another_resumes_the_phase() -> None:
    never = replace(ALWAYS, time=jnp.float64(1e6))
    commands = {"hold_at": 100.0, "resume_at": 200.0}
    assert after(never, situation(100.0), **commands).phase == HOLD
    found = after(never, situation(100.0), situation(200.0), **commands)
    assert (found.phase, found.entered_at) == (0, 200.0)


def test_a_decided_burn_is_finished_first_unless_by_an_abort() -> None:
    pending = situation(100.0, burn_pending=True)
    assert after(ALWAYS, pending).phase == 0
    assert after(ALWAYS, pending, timeout=50.0).phase == 0
    assert after(ALWAYS, pending, hold_at=50.0).phase == 0
    assert after(ALWAYS, pending, abort_at=50.0).phase == ABORTED


FORCED = {
    "lost": (AbortReason.TARGET_LOST, {"lost": True}),
    "confidence": (AbortReason.CONFIDENCE_LOST, {"confident": False}),
    "thruster": (AbortReason.THRUSTER_FAILED, {"thruster_works": False}),
}


@pytest.mark.parametrize("name", FORCED)
def test_failures_are_reasons_for_an_abort_but_in_a_passively_safe_phase(name: str) -> None:
    reason, changes = FORCED[name]
    never = replace(ALWAYS, time=jnp.float64(1e6))
    found = after(never, situation(20.0), situation(40.0, **changes))
    assert (found.phase, found.abort_reason) == (ABORTED, reason)
    assert after(never, situation(40.0, **changes), static=settings(passively_safe=True)).phase == 0


def test_before_the_target_was_seen_its_absence_is_no_reason() -> None:
    never = replace(ALWAYS, time=jnp.float64(1e6))
    unseen = situation(20.0, seen=False, lost=True, confident=False)
    found = mission_manager.update(settings(), tuning(never), start(seen=False), unseen)
    assert found.phase == 0


def test_the_threat_of_the_keep_out_zone_is_a_reason_in_every_phase() -> None:
    never = replace(ALWAYS, time=jnp.float64(1e6))
    found = after(never, situation(20.0, enters_keep_out=True), static=settings(passively_safe=True))
    assert found.abort_reason == AbortReason.KEEP_OUT_PREDICTED


def test_the_threat_of_the_keep_out_zone_counts_before_the_target_was_seen() -> None:
    never = replace(ALWAYS, time=jnp.float64(1e6))
    found = mission_manager.update(settings(), tuning(never), start(seen=False), situation(20.0, enters_keep_out=True))
    assert found.abort_reason == AbortReason.KEEP_OUT_PREDICTED


def test_a_phase_is_not_resumed_before_a_decided_burn_is_finished() -> None:
    held = replace(start(HOLD), held_phase=jnp.int32(1), entered_at=jnp.float64(40.0))
    for pending, phase in ((True, HOLD), (False, 1)):
        now = situation(120.0, burn_pending=pending)
        assert mission_manager.update(settings(), tuning(ALWAYS, resume_at=100.0), held, now).phase == phase


def test_leaving_the_corridor_is_a_reason_in_its_phase_alone() -> None:
    never = replace(ALWAYS, time=jnp.float64(1e6))
    aside = 1.0 + 60.0 * np.tan(np.deg2rad(10.0))
    for offset, phase in ((aside - 0.01, 0), (aside + 0.01, ABORTED)):
        assert after(never, situation(20.0, state_H=jnp.asarray(PLACE).at[2].add(offset))).phase == phase
    behind = situation(20.0, state_H=-jnp.asarray(PLACE))
    assert after(never, behind).abort_reason == AbortReason.CORRIDOR_LEFT
    assert mission_manager.update(settings(), tuning(never), start(phase=1), behind).phase == 1


def test_after_an_abort_there_is_no_other_phase_and_the_first_reason_stays() -> None:
    found = after(ALWAYS, situation(0.0), situation(20.0), abort_at=20.0)
    assert found.abort_reason == AbortReason.COMMAND
    later = mission_manager.update(settings(), tuning(ALWAYS), found, situation(900.0, lost=True))
    assert (later.phase, later.entered_at, later.abort_reason) == (ABORTED, 20.0, AbortReason.COMMAND)


def test_a_phase_knows_what_began_it() -> None:
    never = replace(ALWAYS, time=jnp.float64(1e9))
    assert start().entered_by == Transition.START
    assert after(ALWAYS, situation(0.0), timeout=0.0).entered_by == Transition.CONDITIONS_MET
    for action in ("next", "hold"):
        timed_out = after(never, situation(20.0), timeout=20.0, static=settings(action))
        assert timed_out.entered_by == Transition.TIMEOUT
    held = [situation(20.0 * number) for number in range(4)]
    assert after(ALWAYS, *held[:2], hold_at=20.0, resume_at=60.0).entered_by == Transition.HOLD_COMMAND
    # A phase in which nothing happens keeps what began it.
    assert after(ALWAYS, *held[:3], hold_at=20.0, resume_at=60.0).entered_by == Transition.HOLD_COMMAND
    assert after(ALWAYS, *held, hold_at=20.0, resume_at=60.0).entered_by == Transition.RESUME_COMMAND
    aborted = after(never, situation(20.0), timeout=20.0, static=settings("abort"))
    assert (aborted.entered_by, aborted.abort_reason) == (Transition.ABORT, AbortReason.TIMEOUT)
    assert after(ALWAYS, *held[:2], abort_at=20.0).entered_by == Transition.ABORT


@pytest.mark.parametrize(
    ("conditions", "time", "expected"),
    [
        ({}, 0.0, Condition(0)),
        ({"time": 50.0}, 49.0, Condition.TIME),
        ({"time": 50.0}, 50.0, Condition(0)),
        ({"ground_go": 80.0, "time": 50.0}, 60.0, Condition.GROUND_GO),
        # Since 10 s in the box; the range has never been known so well.
        ({"arrival_box": [1.0, 1.0, 1.0], "arrival_for": 30.0}, 39.0, Condition.ARRIVAL),
        ({"arrival_box": [1.0, 1.0, 1.0], "arrival_for": 30.0}, 40.0, Condition(0)),
        ({"range_sigma": 0.1, "time": 50.0}, 40.0, Condition.RANGE_SIGMA | Condition.TIME),
    ],
)
def test_unmet_conditions_are_those_that_are_given_and_do_not_hold(
    conditions: dict[str, Any], time: float, expected: Condition
) -> None:
    until = replace(ALWAYS, **{name: jnp.asarray(value) for name, value in conditions.items()})
    state = replace(start(), arrived_at=jnp.float64(10.0))
    assert mission_manager.unmet_conditions(until, state, jnp.float64(time)) == expected
    # Before the first decision of a phase nothing is known of its conditions.
    assert mission_manager.unmet_conditions(ALWAYS, start(), jnp.float64(0.0)) == 0


def into_the_target_frame() -> MissionSettings:
    """The three phases, of which those after the first are in the frame of the target."""
    first, *others = settings().phases
    return dataclasses.replace(
        settings(), phases=(first, *(dataclasses.replace(each, in_target_frame=True) for each in others))
    )


STATE_T = jnp.array([1.0, 2.0, 8.0, 0.1, 0.0, 0.0])


def turning(time: float, **changes: Any) -> Situation:
    """Before a target whose attitude is known."""
    return replace(situation(time, **({"attitude_sigma": 0.01} | changes)), state_T=STATE_T)


def test_a_phase_in_the_target_frame_begins_at_once_with_the_state_there() -> None:
    found = after(ALWAYS, turning(40.0), static=into_the_target_frame())
    assert (found.phase, found.starts_at) == (1, 40.0)
    np.testing.assert_array_equal(found.entry.relative_state, STATE_T)


@pytest.mark.parametrize(
    ("changes", "phase"), [({}, 1), ({"attitude_sigma": 0.03}, 0), ({"can_follow": False}, 0), ({"until": ALWAYS}, 2)]
)
def test_it_begins_once_the_attitude_is_known_and_the_thrusters_can_follow(changes: dict[str, Any], phase: int) -> None:
    known = replace(ALWAYS, attitude_sigma=jnp.float64(0.02), attitude_sigma_for=jnp.float64(20.0))
    until = changes.get("until", known)
    changes = {name: value for name, value in changes.items() if name != "until"}
    decisions = [turning(time, **changes) for time in (20.0, 40.0)]
    assert after(until, *decisions, static=into_the_target_frame()).phase == phase


def test_in_the_target_frame_who_may_not_follow_aborts() -> None:
    never, unseen = replace(ALWAYS, time=jnp.float64(1e6)), turning(60.0, may_follow=False)
    for phase, expected in ((0, 0), (1, ABORTED)):
        assert mission_manager.update(into_the_target_frame(), tuning(never), start(phase), unseen).phase == expected


def test_in_the_target_frame_an_unknown_attitude_is_a_reason_for_an_abort() -> None:
    never, lost = replace(ALWAYS, time=jnp.float64(1e6)), turning(60.0, attitude_sigma=np.inf)
    static = into_the_target_frame()
    assert mission_manager.update(static, tuning(never), start(phase=0), lost).phase == 0
    found = mission_manager.update(static, tuning(never), start(phase=1), lost)
    assert (found.phase, found.abort_reason) == (ABORTED, AbortReason.ATTITUDE_LOST)
