"""Where unfinished runs stayed and why, from phase records by hand, in report.json and on the pages."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from report_page_parser import page_text, rendered_page
from synthetic_campaign_results import SyntheticCampaign, synthetic_team

from rpojax.flight.mission.mission_state import Condition, Transition
from rpojax.report.page.report_json import summarise
from rpojax.report.sections import phase_section, phase_visits, team_section
from rpojax.simulation.metrics.phase_records import MAX_TRANSITIONS
from rpojax.simulation.outcomes.outcome_kinds import Outcome

NAMES = ("near", "approach", "stay", "hold", "aborted")
NEAR, APPROACH, STAY, HOLD, ABORTED = range(5)
MET, TIMEOUT, COMMAND = Transition.CONDITIONS_MET, Transition.TIMEOUT, Transition.HOLD_COMMAND
PHASES = [
    {"name": "near", "until": {"range_sigma_m": 0.02}},
    {"name": "approach", "until": {"arrival_box_m": [1.0, 1.0, 1.0]}},
    {"name": "stay"},
]
Stays = list[tuple[float, int, int]]
WAITS: Stays = [(0.0, NEAR, 0)]
ARRIVES: Stays = [(0.0, NEAR, 0), (50.0, APPROACH, MET), (90.0, STAY, MET)]
HELD: Stays = [(0.0, NEAR, 0), (50.0, APPROACH, MET), (90.0, HOLD, TIMEOUT)]
CALLED: Stays = [(0.0, NEAR, 0), (60.0, HOLD, COMMAND)]
CARRIED: Stays = [(0.0, NEAR, 0), (50.0, APPROACH, MET), (90.0, STAY, TIMEOUT)]
SIGMA, BOTH = Condition.RANGE_SIGMA, Condition.RANGE_SIGMA | Condition.ARRIVAL


def records(stays: list[Stays], unmet: list[int]) -> dict[str, np.ndarray]:
    runs = len(stays)
    shape = (runs, MAX_TRANSITIONS)
    found: dict[str, Any] = {
        "transition_phase": np.full(shape, -1, np.int8),
        "transition_by": np.full(shape, -1, np.int8),
        "transition_at_s": np.full(shape, np.nan),
        "transition_count": np.array([len(each) for each in stays], np.int32),
        "unmet_conditions": np.array(unmet, np.int8),
        "abort_reason": np.zeros(runs, np.int8),
        "duration_s": np.full((runs, len(NAMES)), 60.0),
        "goal_reached_at_s": np.array([90.0 if each is ARRIVES else np.nan for each in stays]),
    }
    for run, each in enumerate(stays):
        for place, (begin_s, number, by) in enumerate(each):
            found["transition_at_s"][run, place] = begin_s
            found["transition_phase"][run, place], found["transition_by"][run, place] = number, by
    names = ("delta_v_m_s", "formation_error_rms_m", "nees_relative_mean", "min_range_m", "max_range_m")
    return found | {name: np.ones((runs, len(NAMES))) for name in names}


@pytest.fixture
def campaign(build: Callable[..., SyntheticCampaign]) -> SyntheticCampaign:
    """Five runs, of which the second completes."""
    found = build(runs=5, seconds=120, kept=())
    found.phases, found.phase_names = records([WAITS, ARRIVES, HELD, CALLED, WAITS], [SIGMA, 0, BOTH, SIGMA, 0]), NAMES
    found.info["scenario"]["phases"] = PHASES
    found.outcomes[[0, 2, 3, 4]] = str(Outcome.UNFINISHED)
    found.failure_reason = np.where(found.outcomes == "unfinished", "unfinished", "")
    found.completed = found.outcomes == "completed"
    found.failed_at_s = np.where(found.completed, np.nan, 0.0)
    return found


def test_the_phase_in_which_a_run_stayed_and_what_did_not_hold_are_told(campaign: SyntheticCampaign) -> None:
    assert phase_visits.unfinished_details(campaign) == {
        0: "stayed in near: range_sigma_m not met",
        2: "held after the timeout of approach: arrival_box_m, range_sigma_m not met",
        3: "held by command in near",
        4: "stayed in near",
    }
    found = [(failure["run_id"], failure["outcome"]) for failure in summarise(campaign)["failures"]]
    assert found == [(run, "unfinished") for run in (0, 2, 3, 4)]
    assert summarise(campaign)["failures"][0]["detail"] == "stayed in near: range_sigma_m not met"


def test_a_goal_that_was_left_by_a_timeout_is_told(campaign: SyntheticCampaign) -> None:
    campaign.info["scenario"]["goal"] = {"phase": "approach"}
    campaign.phases = records([CARRIED] * 5, [0] * 5)
    assert phase_visits.unfinished_details(campaign)[0] == "left approach by timeout"


def test_the_goal_is_that_of_the_scenario_or_the_last_phase(campaign: SyntheticCampaign) -> None:
    found = phase_section.content(campaign)
    assert found is not None
    at_s = {"p5": 90.0, "p50": 90.0, "p95": 90.0}
    assert found["goal"] == {"phase": "stay", "at": "begin", "reached": 1, "runs": 5, "at_s": at_s}
    assert phase_section.goal_text(found) == "Goal: the begin of stay, reached in 1 of 5 runs, at 90 s."
    for given, expected in (
        ({"phase": "approach"}, ("approach", "end")),
        ({"phase": "approach", "at": "begin"}, ("approach", "begin")),
        ({"phase": "aborted"}, ("aborted", "begin")),
        ({"phase": "none"}, None),
    ):
        assert phase_visits.goal_of({"phases": PHASES, "goal": given}) == expected
    # Results of an older version.
    del campaign.phases["goal_reached_at_s"]
    found = phase_section.content(campaign)
    assert found is not None
    assert phase_section.goal_text(found) == ""


def test_the_page_tells_it_on_its_first_screen_and_among_the_failures(campaign: SyntheticCampaign) -> None:
    words = page_text(rendered_page(campaign))
    assert (
        "4 of 5 runs failed (95 %: 28 to 99 %): the goal of the mission was not reached. No cause was found; "
        "most often stayed" in words
    )
    assert "1 \N{MULTIPLICATION SIGN} unfinished: held by command in near." in words
    assert "reached in 1 of 5 runs" in words


def test_a_run_that_is_not_judged_says_so_on_its_page(build: Callable[..., SyntheticCampaign]) -> None:
    campaign = build(runs=1, kept=(0,))
    campaign.outcomes[0], campaign.completed[0] = "not_judged", False
    words = page_text(rendered_page(campaign))
    assert "The run is not judged: it ends before limits.arrive_by_s" in words
    assert "The run completed" not in words


def test_of_a_team_the_servicers_that_stayed_are_named(build: Callable[..., SyntheticCampaign]) -> None:
    campaign = synthetic_team(build(runs=2, kept=()).directory, runs=2, kept=())
    own = [records([ARRIVES, WAITS], [0, SIGMA]), records([CALLED, ARRIVES], [0, 0])]
    campaign.servicer_groups["phases"] = {name: np.stack([each[name] for each in own], axis=1) for name in own[0]}
    campaign.servicer_groups["traces"] = {}
    codes = np.zeros((2, 2), np.int8)
    codes[1, 0] = Outcome.UNFINISHED.code
    campaign.servicer_groups["status"]["failure"] = codes
    campaign.phase_names = NAMES
    campaign.info["scenario"] |= {
        "phases": PHASES,
        "servicers": [{"name": "near"}, {"name": "far", "goal": {"phase": "hold"}}],
    }
    campaign.outcomes[1] = "unfinished"
    assert team_section.unfinished_details(campaign) == {1: "near stayed in near: range_sigma_m not met"}
    # A run has the outcome of its worst servicer.
    campaign.outcomes[1] = "lost"
    assert team_section.unfinished_details(campaign) == {}
