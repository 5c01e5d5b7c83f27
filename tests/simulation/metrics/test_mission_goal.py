"""Goal of a mission from phase tables by hand: which phase, when it is reached, and the outcome of runs without it."""

import numpy as np
import pytest

from rpojax.errors import RpojaxError
from rpojax.flight.mission.mission_state import AbortReason, Condition, Transition
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics.mission_goal import MissionGoal, entered_at_s, mission_goal, reached_at_s
from rpojax.simulation.outcomes import outcome_kinds, team_outcome
from rpojax.simulation.outcomes.judgement import JudgedRuns, judge

TICKS = 4000
NEAR, APPROACH, STAY, HOLD, ABORTED = range(5)
MET, TIMEOUT, COMMAND, ABORT = (
    Transition.CONDITIONS_MET,
    Transition.TIMEOUT,
    Transition.HOLD_COMMAND,
    Transition.ABORT,
)
Changes = list[tuple[int, int, Transition]]


def mission(**goal: str) -> ScenarioFile:
    """Three phases of a tick a second; the second ends by arrival, the last by none unless it has conditions."""
    tables = scenario_loader.load("inspection", ["requirements=[]"]).model_dump()
    place = {"kind": "hold", "position_m": [0.0, -30.0, 0.0]}
    last = {"name": "stay", "reference": place}
    if goal.pop("last", "") == "ends":
        last["until"] = {"range_sigma_m": 0.1}
    phases = [
        {"name": "near", "reference": place, "until": {"time_s": 100.0}},
        {"name": "approach", "reference": place, "until": {"arrival_box_m": [1.0, 1.0, 1.0]}, "timeout_s": 900.0},
        last,
    ]
    return scenario_loader.validate(tables | {"phases": phases, "goal": goal})


def records(*runs: Changes, unmet: int = 0) -> dict[str, np.ndarray]:
    """Runs on their references that change their phases at these ticks; conditions of the last one are `unmet`."""
    count = len(runs)
    flag = np.ones((count, TICKS), bool)
    phase, by = np.zeros((2, count, TICKS), np.int8)
    for run, changes in enumerate(runs):
        for tick, number, cause in changes:
            phase[run, tick:], by[run, tick:] = number, cause
    still = np.zeros((count, TICKS, 3), np.float32)
    return {
        "box_accepted": flag,
        "box_outlier": ~flag,
        "observable": flag,
        "nees_relative": np.full((count, TICKS), 6.0, np.float32),
        "relative_error_H": np.zeros((count, TICKS, 3), np.float32),
        "relative_sigma_H": np.ones((count, TICKS, 3), np.float32),
        "rho_H": still,
        "rho_desired_H": still.copy(),
        "propellant_used_kg": np.zeros((count, TICKS), np.float32),
        "running": flag.copy(),
        "phase": phase,
        "phase_entered_by": by,
        "abort_reason": np.where(phase == ABORTED, AbortReason.COMMAND, AbortReason.NONE).astype(np.int8),
        "unmet_conditions": np.where(phase == STAY, np.int8(unmet), np.int8(Condition.ARRIVAL)),
    }


def judged(file: ScenarioFile, found: dict[str, np.ndarray]) -> JudgedRuns:
    runs = len(found["running"])
    return judge(file, {}, found, np.zeros(runs, np.int8), np.full(runs, np.nan))


def outcomes(file: ScenarioFile, found: dict[str, np.ndarray]) -> list[str]:
    return outcome_kinds.of_codes(judged(file, found).codes).tolist()


STAYS: Changes = []
ARRIVES: Changes = [(500, APPROACH, MET), (900, STAY, MET)]
HELD: Changes = [(500, APPROACH, MET), (1400, HOLD, TIMEOUT)]
CARRIED: Changes = [(500, APPROACH, MET), (1400, STAY, TIMEOUT)]
LEAVES: Changes = [(500, APPROACH, MET), (600, ABORTED, ABORT)]


def test_the_default_goal_is_the_last_phase_and_its_end_where_it_has_one() -> None:
    assert mission_goal(mission()) == MissionGoal("stay", STAY, "begin")
    assert mission_goal(mission(last="ends")) == MissionGoal("stay", STAY, "end")
    assert mission_goal(mission(phase="approach")) == MissionGoal("approach", APPROACH, "end")
    assert mission_goal(mission(phase="approach", at="begin")) == MissionGoal("approach", APPROACH, "begin")
    assert mission_goal(mission(phase="aborted")) == MissionGoal("aborted", ABORTED, "begin")
    assert mission_goal(mission(phase="none")) is None
    assert mission_goal(scenario_loader.load("inspection")) is None


def test_runs_that_do_not_come_to_the_last_phase_are_unfinished_since_they_stay() -> None:
    found = records(STAYS, HELD, ARRIVES, LEAVES, CARRIED)
    assert outcomes(mission(), found) == ["unfinished", "unfinished", "completed", "aborted", "completed"]
    judgement = judged(mission(), found)
    assert judgement.failed.tolist() == [True, True, False, True, False]
    np.testing.assert_array_equal(judgement.since_s, [0.0, 1400.0, np.nan, 600.0, np.nan])
    np.testing.assert_array_equal(reached_at_s(mission(), found), [np.nan, np.nan, 900.0, np.nan, 1400.0])
    np.testing.assert_array_equal(entered_at_s(mission(), found), [0.0, 1400.0, 900.0, 600.0, 1400.0])


def test_a_last_phase_with_conditions_must_meet_them_once() -> None:
    file = mission(last="ends")
    found = records(ARRIVES, unmet=Condition.RANGE_SIGMA)
    assert outcomes(file, found) == ["unfinished"]
    # The conditions of the phase before do not count, nor what would have come after the run was frozen.
    found["unmet_conditions"][:, :900] = 0
    assert outcomes(file, found) == ["unfinished"]
    found["unmet_conditions"][:, 2000:2010] = 0
    assert outcomes(file, found) == ["completed"]
    assert reached_at_s(file, found).tolist() == [2000.0]
    found["running"][:, 1500:] = False
    assert np.isnan(reached_at_s(file, found)).all()


def test_a_phase_that_times_out_has_not_ended_by_its_conditions() -> None:
    found = records(ARRIVES, CARRIED, HELD, STAYS)
    assert outcomes(mission(phase="approach"), found) == ["completed", "unfinished", "unfinished", "unfinished"]
    begun = mission(phase="approach", at="begin")
    assert outcomes(begun, found) == ["completed", "completed", "completed", "unfinished"]


def test_a_goal_may_be_a_hold_an_abort_or_nothing() -> None:
    found = records(ARRIVES, [(700, HOLD, COMMAND)], LEAVES)
    assert outcomes(mission(phase="hold"), found) == ["unfinished", "completed", "aborted"]
    assert outcomes(mission(phase="aborted"), found) == ["unfinished", "unfinished", "completed"]
    assert outcomes(mission(phase="none"), found) == ["completed", "completed", "aborted"]


def test_after_an_abort_that_is_the_goal_only_what_comes_before_an_abort_counts() -> None:
    found = records(LEAVES, LEAVES, STAYS)
    found["rho_H"] = found["rho_H"] + np.float32(1000.0)
    found["box_accepted"] = np.zeros((3, TICKS), bool)
    found["propellant_used_kg"][1] = 1e6
    assert outcomes(mission(phase="aborted"), found) == ["completed", "out_of_propellant", "lost"]


def test_other_failures_come_before_the_missed_goal() -> None:
    found = records(STAYS, STAYS)
    found["rho_H"][1] += np.float32(100.0)
    assert outcomes(mission(), found) == ["unfinished", "off_station"]


def test_a_mission_of_one_phase_without_an_end_is_station_keeping_and_may_be_too_short() -> None:
    tables = mission().model_dump()
    file = scenario_loader.validate(tables | {"phases": tables["phases"][2:]})
    found = {name: values[:, :2000] for name, values in records(STAYS).items()}
    assert outcomes(file, found) == ["not_judged"]
    # One that has something to reach is judged by that.
    assert outcomes(mission(), found) == ["unfinished"]
    found = {name: values[:, :2000] for name, values in records(ARRIVES).items()}
    assert outcomes(mission(), found) == ["completed"]


def test_a_team_is_as_unfinished_as_its_worst_servicer() -> None:
    file = mission()
    first = judged(file, records(ARRIVES, ARRIVES, STAYS, ARRIVES))
    second = judged(file, records(ARRIVES, STAYS, LEAVES, ARRIVES))
    short = JudgedRuns(np.array([0, 0, 0, 9], np.int8), np.full(4, np.nan), first.events)
    codes = team_outcome.worst([first, second, short]).codes
    assert outcome_kinds.of_codes(codes).tolist() == ["completed", "unfinished", "aborted", "not_judged"]


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ({"phase": "dock"}, "goal.phase: found 'dock', expected one of near, approach, stay, hold, aborted, none"),
        ({"at": "end"}, "goal.at: found 'end', expected begin, as phase stay has no conditions until that end it"),
        ({"phase": "hold", "at": "end"}, "goal.at: found 'end', expected begin, as phase hold has no"),
        ({"phase": "none", "at": "begin"}, "goal.at: found 'begin', expected it only beside a phase"),
        ({"by_s": 1.0}, "goal.by_s: unknown key"),
    ],
)
def test_a_goal_that_no_run_can_reach_is_refused(goal: dict[str, str], message: str) -> None:
    with pytest.raises(RpojaxError) as caught:
        mission(**goal)
    assert message in str(caught.value)


def test_without_phases_there_is_no_goal_but_none() -> None:
    assert scenario_loader.load("inspection", ["goal.phase=none"]).goal.phase == "none"
    for override, key in (("goal.phase=stay", "goal.phase"), ("goal.at=begin", "goal.at")):
        with pytest.raises(RpojaxError, match=key):
            scenario_loader.load("inspection", [override])
    with pytest.raises(RpojaxError, match=r"phases\.name: found 'none'"):
        tables = mission().model_dump()
        scenario_loader.validate(tables | {"phases": [{**tables["phases"][2], "name": "none"}]})


def test_packaged_missions_that_abort_on_purpose_have_that_as_their_goal() -> None:
    assert mission_goal(scenario_loader.load("inspection_abort")) == MissionGoal("aborted", 4, "begin")
    team = scenario_loader.load("cooperative_faults")
    assert [None if each.goal is None else each.goal.phase for each in team.servicers] == [None, None, "aborted"]
