"""Phases and aborts in report.json and on the page: counted by hand over five runs."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from report_page_parser import page_text, rendered_page
from synthetic_campaign_results import SyntheticCampaign

from rpojax.flight.mission.mission_state import AbortReason, Transition
from rpojax.report.page.html_report import write_report
from rpojax.report.sections import phase_section, phase_visits
from rpojax.simulation.metrics.phase_records import MAX_TRANSITIONS

NAMES = ("drift", "stay", "hold", "aborted")
DRIFT, STAY, HOLD, ABORTED = range(4)
MET, TIMEOUT, ABORT = Transition.CONDITIONS_MET, Transition.TIMEOUT, Transition.ABORT
HELD, RESUMED = Transition.HOLD_COMMAND, Transition.RESUME_COMMAND
STAYS = [
    [(0.0, DRIFT, 0), (100.0, STAY, MET)],
    [(0.0, DRIFT, 0), (200.0, STAY, TIMEOUT), (300.0, ABORTED, ABORT)],
    [(0.0, DRIFT, 0), (50.0, HOLD, HELD), (80.0, DRIFT, RESUMED), (160.0, STAY, MET)],
    [(0.0, DRIFT, 0), (400.0, ABORTED, ABORT)],
    [(0.0, DRIFT, 0), (90.0, STAY, MET)],
]
"""Begin, number and cause of the stays of each run; the last one is frozen at 300 s."""


@pytest.fixture
def mission(build: Callable[..., SyntheticCampaign]) -> SyntheticCampaign:
    """Five runs of 600 s with the stays above and ranges of their own after the aborts."""
    campaign = build(runs=5, seconds=600, kept=(), failed=(4,))
    shape = (5, MAX_TRANSITIONS)
    phase, by, at_s = np.full(shape, -1, np.int8), np.full(shape, -1, np.int8), np.full(shape, np.nan)
    for run, stays in enumerate(STAYS):
        for place, (begin, number, cause) in enumerate(stays):
            at_s[run, place], phase[run, place], by[run, place] = begin, number, cause
    least = np.full((5, 4), np.nan)
    least[[1, 3], ABORTED] = 25.0, 8.0
    numbers = {name: np.where(np.arange(4) < 2, 1.0, np.nan) * np.ones((5, 1)) for name in FIGURES}
    campaign.phases = {
        **numbers,
        "duration_s": np.full((5, 4), 60.0),
        "min_range_m": least,
        "abort_reason": np.array([0, AbortReason.TARGET_LOST, 0, AbortReason.COMMAND, 0], np.int8),
        "transition_count": np.array([len(stays) for stays in STAYS], np.int32),
        "transition_phase": phase,
        "transition_by": by,
        "transition_at_s": at_s,
    }
    campaign.phase_names = NAMES
    campaign.metrics["final_range_m"] = np.array([30.0, 70.0, 30.0, 80.0, np.nan])
    campaign.metrics["final_drift_range_24_h_m"] = np.array([30.0, 9.0, 30.0, np.nan, np.nan])
    return campaign


FIGURES = ("delta_v_m_s", "formation_error_rms_m", "nees_relative_mean", "max_range_m")


def content(campaign: SyntheticCampaign) -> dict[str, Any]:
    found = phase_section.content(campaign)
    assert found is not None
    return found


def test_begin_end_and_ends_of_phases_are_counted(mission: SyntheticCampaign) -> None:
    found = {phase["name"]: phase for phase in content(mission)["phases"]}
    assert {name: phase["runs"] for name, phase in found.items()} == {"drift": 5, "stay": 4, "hold": 1, "aborted": 2}
    # The drift that was resumed begins once, and ends when it is left for good.
    assert found["drift"]["begin_s"] == {"p5": 0.0, "p50": 0.0, "p95": 0.0}
    assert found["drift"]["end_s"]["p50"] == np.median([100.0, 200.0, 160.0, 400.0, 90.0])
    assert found["stay"]["begin_s"]["p95"] == pytest.approx(np.percentile([100.0, 200.0, 160.0, 90.0], 95.0))
    assert found["stay"]["end_s"] == {"p5": 300.0, "p50": 300.0, "p95": 300.0}
    assert found["aborted"]["end_s"] == {"p5": None, "p50": None, "p95": None}
    ends = {name: {end: count for end, count in phase["ends"].items() if count} for name, phase in found.items()}
    assert ends == {
        "drift": {"conditions_met": 3, "timeout": 1, "hold_command": 1, "abort": 1},
        "stay": {"abort": 1, "end_of_run": 2, "failure": 1},
        "hold": {"resume_command": 1},
        "aborted": {"end_of_run": 2},
    }


def test_aborts_are_counted_by_reason_and_phase_with_their_ranges(mission: SyntheticCampaign) -> None:
    aborts = content(mission)["aborts"]
    assert (aborts["count"], aborts["runs"]) == (2, 5)
    rows = [(group["reason"], group["phase"], group["count"], group["nearest_runs"]) for group in aborts["by_reason"]]
    assert sorted(rows) == [("command", "drift", 1, [3]), ("target lost", "stay", 1, [1])]
    assert aborts["least"]["least_range_m"] == {"value": 8.0, "run_id": 3, "runs": 2}
    assert aborts["least"]["final_range_m"] == {"value": 70.0, "run_id": 1, "runs": 2}
    assert aborts["least"]["final_drift_range_24_h_m"] == {"value": 9.0, "run_id": 1, "runs": 1}
    assert aborts["below_keep_out"] == {"least_range_m": 1, "final_range_m": 0, "final_drift_range_24_h_m": 1}
    texts = phase_section.abort_sentences(aborts)
    assert [alert for _, alert in texts] == [False, True, False, True]
    assert "All 2 stayed at 70 m or more at the end of the run (nearest: run 1)." in texts[2][0]
    assert texts[3][0].startswith("The 1 for which it is known")


def test_a_run_that_enters_the_sphere_after_its_abort_is_inside(mission: SyntheticCampaign) -> None:
    mission.outcomes[1] = "keep_out"
    aborts = content(mission)["aborts"]
    assert aborts["listed"][0]["least_range_m"] == 10.0
    assert aborts["below_keep_out"]["least_range_m"] == 2


def test_shares_add_up_to_the_runs_that_go_on(mission: SyntheticCampaign) -> None:
    chart = phase_visits.share_chart(mission)
    assert chart is not None
    traces = {trace["name"]: dict(zip(trace["x"], trace["y"], strict=True)) for trace in chart["data"]}
    assert list(traces) == list(NAMES)
    for time, shares in {
        0.0: [100, 0, 0, 0],
        60.0: [80, 0, 20, 0],
        250.0: [20, 80, 0, 0],
        600.0: [0, 40, 0, 40],
    }.items():
        assert [traces[name][time] for name in NAMES] == shares, time


def test_more_stays_than_recorded_are_told(mission: SyntheticCampaign) -> None:
    mission.phases["transition_count"][0] = MAX_TRANSITIONS + 8
    found = content(mission)
    assert found["runs_with_further_stays"] == 1
    assert found["phases"][STAY]["ends"]["end_of_run"] == 1


def test_the_page_shows_phases_and_aborts(mission: SyntheticCampaign) -> None:
    page = rendered_page(mission)
    text = page_text(page)
    assert "1 \N{MULTIPLICATION SIGN} command to hold" in text
    assert "2 of 5 runs aborted" in text
    assert f"rpojax rerun {mission.directory} --run-id 1 --out run_1" in text
    assert "phase-shares" in {attributes.get("data-chart") for _, attributes in page.tags}
    assert "phase-shares" in json.loads(page.data)["charts"]
    assert json.loads((mission.directory / "report.json").read_text())["mission"]["aborts"]["count"] == 2


def test_without_phases_the_page_has_no_such_section(build: Callable[..., SyntheticCampaign]) -> None:
    campaign = build(runs=3, seconds=30, kept=())
    text = write_report(campaign).read_text(encoding="utf-8")
    assert 'id="mission"' not in text
    assert "phase-shares" not in text
    assert json.loads((campaign.directory / "report.json").read_text())["mission"] is None
    assert phase_visits.share_chart(campaign) is None
