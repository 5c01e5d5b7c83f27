"""Why runs failed, on the page, in report.json, in the terminal and of runs that aborted, of planted results."""

from collections.abc import Callable

import numpy as np
import pytest
from report_page_parser import page_text, rendered_page
from synthetic_campaign_results import SyntheticCampaign

from rpojax.cli import console
from rpojax.flight.mission.mission_state import AbortReason, Transition
from rpojax.report.page.report_json import summarise
from rpojax.report.sections import cause_section
from rpojax.scenario.loading import scenario_loader
from rpojax.simulation.metrics import failure_signs

FAILED = (2, 5, 7)
WORDS = (
    "3 of 12 failed: in all 3 the detector misses the target in 90 % of the frames that show it (10 % believed); "
    "a detector that finds it in 90 % of them."
)


@pytest.fixture
def missing(build: Callable[..., SyntheticCampaign]) -> SyntheticCampaign:
    """Campaign of `inspection` in which three of twelve runs lose the target as its detector misses it."""
    campaign = build(runs=12, failed=FAILED)
    campaign.info["scenario"] = {**scenario_loader.load("inspection").model_dump(), "requirements": []}
    campaign.outcomes = np.where(campaign.completed, "completed", "lost")
    campaign.failure_reason = np.where(campaign.completed, "", "lost the target")
    campaign.drawn = {}
    full = np.full((12, 64), 94, np.int32)
    signs = {name: np.zeros_like(full) for name in (*failure_signs.COUNTS, failure_signs.FAILED_TESTS)}
    signs |= {"ticks": full, "looking": full, "in_view": full}
    signs["good_boxes"] = np.where(campaign.completed[:, None], 90, 9).astype(np.int32)
    campaign.signs = signs
    return campaign


def test_the_sentence_has_runs_evidence_and_what_mends_it(missing: SyntheticCampaign) -> None:
    found = cause_section.content(missing)
    [cause] = found["causes"]
    assert (cause["name"], cause["runs"], cause["run_ids"], found["without"]) == ("misses", 3, list(FAILED), 0)
    assert found["sentence"] == WORDS


def test_first_screen_failed_runs_and_next_steps_tell_it(missing: SyntheticCampaign) -> None:
    words = page_text(rendered_page(missing))
    evidence = "the detector misses the target in 90 % of the frames that show it (10 % believed)"
    assert "3 of 12 runs failed (95 %: 5.5 to 57 %): lost the target. The cause in all 3: boxes are missing." in words
    mended = "a detector that finds it in 90 % of them repeat run 2 rpojax rerun"
    assert f"All 3 failed runs boxes are missing: {evidence} {mended}" in words
    assert "3 lost the target; boxes are missing" in words
    assert words.count("the detector misses the target in 90 % of the frames") >= 5  # headline, two tables, three runs


def test_failures_of_the_summary_have_their_cause_and_the_terminal_a_line(
    missing: SyntheticCampaign, capsys: pytest.CaptureFixture[str]
) -> None:
    summary = summarise(missing)
    assert [each["cause"] for each in summary["failures"]] == ["misses"] * 3
    assert "texts" not in summary["why_failed"]["causes"][0]
    console.show_campaign(summary)
    assert "why: 3 x the detector misses the target in 90 % of the frames that show it" in capsys.readouterr().out


def test_failed_runs_without_a_cause_are_counted(missing: SyntheticCampaign) -> None:
    missing.signs = {}
    found = cause_section.content(missing)
    assert found["sentence"] == "3 of 12 failed: no cause was found in 3."
    assert summarise(missing)["failures"][0]["cause"] == ""


def test_a_campaign_without_failures_has_none(campaign: SyntheticCampaign) -> None:
    assert cause_section.content(campaign) == {"failed": 0, "runs": 40, "causes": [], "without": 0, "sentence": ""}


def test_a_scenario_of_another_version_gives_no_cause(build: Callable[..., SyntheticCampaign]) -> None:
    found = cause_section.content(build(runs=12, failed=FAILED))
    assert (found["causes"], found["without"]) == ([], 3)


def test_an_abort_has_reason_phase_and_time(missing: SyntheticCampaign) -> None:
    missing.outcomes = np.where(missing.completed, "completed", "aborted")
    missing.phase_names = ("hold_50", "approach", "hold", "aborted")
    shape = (12, 32)
    phase, by, at_s = np.full(shape, -1, np.int8), np.full(shape, -1, np.int8), np.full(shape, np.nan)
    phase[:, :2], by[:, :2], at_s[:, :2] = (0, 1), (Transition.START, Transition.CONDITIONS_MET), (0.0, 100.0)
    failed = ~missing.completed
    phase[failed, 2], by[failed, 2], at_s[failed, 2] = 3, Transition.ABORT, 250.0
    missing.phases = {
        "transition_phase": phase,
        "transition_by": by,
        "transition_at_s": at_s,
        "transition_count": (phase >= 0).sum(axis=1),
        "abort_reason": np.where(failed, AbortReason.CORRIDOR_LEFT, AbortReason.NONE).astype(np.int8),
    }
    assert cause_section.abort_details(missing) == dict.fromkeys(FAILED, "corridor left in approach at 250 s")
