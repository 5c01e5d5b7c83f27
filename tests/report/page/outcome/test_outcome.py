"""The first screen: sentence, verdicts, figures and next steps, from entries of report.json written by hand."""

import copy

import numpy as np
import pytest
from report_page_parser import page_text, rendered_page

from rpojax.report.labels import format_number
from rpojax.report.page import report_json
from rpojax.report.page.first_screen import (
    entry_margin,
    leading_figures,
    next_steps,
    outcome_sentence,
    verdict_tiles,
    weakest_requirement,
)
from rpojax.simulation.outcomes.outcome_kinds import Outcome


def requirement(metric, bound, limit, verdict, margin, worst, **more):
    entry = {
        "metric": metric,
        "bound": bound,
        "limit": limit,
        "verdict": verdict,
        "verdict_text": verdict,
        "margin": margin,
        "worst": worst,
        "probability": 0.99,
        "consumer_risk": 0.1,
        "runs": 500,
        "violations": 0,
        "beyond_limit": 0,
        "without_value": 0,
        "allowed": 2,
        "rank": 498,
        "order_statistic": 1.0,
        "success": 1.0,
        "success_interval": [0.99, 1.0],
        "risk_reached": 0.01,
        "violating_ids": [],
        "more_runs": None,
        "text": f"{metric} {bound} {limit}",
    }
    return entry | more


CONTENT = {
    "runs": {
        "requested": 500,
        "completed": 500,
        "failed": 0,
        "not_judged": 0,
        "missing": 0,
        "outcomes": {**dict.fromkeys(map(str, Outcome), 0), "completed": 500},
    },
    "requirements": [
        requirement("formation_error_rms_m", "at most", 2.0, "verified", 0.9, 1.2),
        requirement("min_range_m", "at least", 15.0, "verified", 3.0, 17.0),
        requirement("nav_relative_position_error_rms_m", "at most", 1.5, "verified", 0.15, 1.4),
    ],
    "safety": {
        "free_drift": [
            {"horizon": "1_orbit", "least_range": None, "below_keep_out": {"count": 0, "runs": 500}},
            {
                "horizon": "24_h",
                "least_range": {"value": 0.5, "run_id": 7},
                "below_keep_out": {"count": 194, "runs": 500},
            },
        ],
        "stuck_on": {"least_range": {"value": 1.4, "run_id": 11}, "below_keep_out": {"count": 12, "runs": 500}},
        "passive_below_keep_out": None,
        "least_passive_range": None,
    },
    "failures": [],
    "why_failed": {"failed": 0, "runs": 500, "causes": [], "without": 0, "sentence": ""},
    "metrics": {},
    "sensitivity": [],
}


def test_sentence_has_verdicts_runs_weakest_margin_and_passive_safety():
    assert outcome_sentence(CONTENT) == (
        "3 of 3 requirements verified in 500 runs, each for 99 % of the runs at 10 % risk; weakest margin 0.150 m "
        "(relative navigation error); passive safety fails: 194 of 500; no run failed."
    )


def ended(completed, **outcomes):
    """The content of 500 runs that ended so, those that are unfinished in the phase `near`."""
    found = copy.deepcopy(CONTENT)
    not_judged = outcomes.get("not_judged", 0)
    counts = {"completed": completed, "failed": 500 - completed - not_judged, "not_judged": not_judged}
    found["runs"] |= counts | {"outcomes": {**dict.fromkeys(map(str, Outcome), 0), "completed": completed, **outcomes}}
    detail = "stayed in near: range_sigma_m not met"
    found["failures"] = [{"run_id": run, "detail": detail} for run in range(outcomes.get("unfinished", 0))]
    return found


def test_the_first_screen_says_first_that_the_goal_was_missed():
    missed = ended(140, unfinished=360)
    assert outcome_sentence(missed).startswith(
        "The goal of the mission was not reached in 360 of 500 runs: stayed in near: range_sigma_m not met; 3 of 3 "
    )
    assert outcome_sentence(missed).endswith("; 360 of 500 runs failed.")
    [tile] = [tile for tile in verdict_tiles(missed) if tile.title == "Failed runs"]
    assert (tile.value, tile.note, tile.css_class) == (
        "360 of 500",
        "360 unfinished; stayed in near: range_sigma_m not met",
        "alert",
    )


@pytest.mark.parametrize(
    ("completed", "not_judged", "words"),
    [
        (0, 500, "no run is judged, as all end before limits.arrive_by_s."),
        (490, 10, "10 of 500 runs are not judged, as they end before limits.arrive_by_s."),
    ],
)
def test_runs_that_are_not_judged_are_no_success_on_the_first_screen(completed, not_judged, words):
    content = ended(completed, not_judged=not_judged)
    assert outcome_sentence(content).endswith(f"; {words}")
    assert "no run failed" not in outcome_sentence(content)
    tiles = {tile.title: (tile.value, tile.css_class) for tile in verdict_tiles(content)}
    assert tiles["Failed runs"] == ("0 of 500", "open")
    assert tiles["Runs not judged"] == (f"{not_judged} of 500", "open")


def test_weakest_requirement_is_by_the_margin_relative_to_its_limit():
    weakest = weakest_requirement(CONTENT["requirements"])
    assert weakest is not None
    assert weakest["metric"] == "nav_relative_position_error_rms_m"
    # Without a rank the margin is that of the worst run: 15 m less 17 m, on the good side.
    assert entry_margin(requirement("min_range_m", "at least", 15.0, "needs more runs", None, 17.0)) == 2.0


def test_no_margin_is_claimed_where_a_run_without_a_value_is_the_worst():
    without = {**CONTENT["requirements"][0], "margin": None, "worst": 1.0, "without_value": 2}
    assert entry_margin(without) is None
    assert weakest_requirement([*CONTENT["requirements"], without]) is None


def test_passive_safety_is_a_red_tile_before_all_others_and_turns_green():
    tiles = verdict_tiles(CONTENT)
    assert (tiles[0].title, tiles[0].value, tiles[0].css_class) == ("Passive safety", "fails: 194 of 500", "alert")
    assert "nearest 0.500 m, run 7" in tiles[0].note
    safe = copy.deepcopy(CONTENT)
    safe["safety"]["free_drift"][1]["below_keep_out"]["count"] = 0
    [passive] = [tile for tile in verdict_tiles(safe) if tile.title == "Passive safety"]
    assert (passive.value, passive.css_class) == ("holds: 500 of 500", "good")


def test_leading_figures_are_range_weakest_channel_and_weakest_histogram():
    charts = {"envelope-range_m", "envelope-nav_relative_error_m", "envelope-delta_v_m_s"}
    charts |= {"histogram-nav_relative_position_error_rms_m", "histogram-min_range_m"}
    found = [figure.chart for figure in leading_figures(CONTENT, charts)]
    assert found == [
        "envelope-range_m",
        "envelope-nav_relative_error_m",
        "histogram-nav_relative_position_error_rms_m",
    ]
    mission = {"phases": [{"name": "hold", "runs": 500}, {"name": "approach", "runs": 20}]}
    drawn = {"envelope-range_m", "phase-shares"}
    assert leading_figures({**CONTENT, "mission": mission}, drawn)[0].chart == "phase-shares"
    mission["phases"][1]["runs"] = 0
    assert leading_figures({**CONTENT, "mission": mission}, drawn)[0].chart == "envelope-range_m"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"verdict": "not verified", "violations": 9, "violating_ids": [3]}, "Not verified: formation_error_rms_m"),
        ({"verdict": "needs more runs", "more_runs": 30}, "simulate at least 530 as a new campaign with another seed"),
    ],
)
def test_next_steps_follow_from_what_was_found(campaign, change, words):
    content = copy.deepcopy(CONTENT)
    content["requirements"][0] |= change
    steps = next_steps(campaign, content)
    assert steps[0].text.startswith("After a loss of thrust 194 of 500 runs could drift into the keep-out sphere")
    assert steps[1].text.startswith("After a burn that did not end 12 of 500 runs could")
    assert any(words in step.text for step in steps)
    assert all(step.command.startswith("rpojax ") for step in steps[:2])


def test_the_run_to_look_at_is_one_beyond_the_limit_and_not_one_that_failed(campaign):
    content = copy.deepcopy(CONTENT)
    violated = {"verdict": "not verified", "violations": 3, "violating_ids": [3, 7, 12], "without_value": 2}
    content["requirements"][0] |= {**violated, "beyond_limit": 1}
    assert "--run-id 12 " in next(step.command for step in next_steps(campaign, content) if "Not" in step.text)
    content["requirements"][0] |= {"violating_ids": [3, 7], "violations": 2, "beyond_limit": 0}
    assert "--run-id 3 " in next(step.command for step in next_steps(campaign, content) if "Not" in step.text)


def test_failed_runs_without_a_value_are_told_apart_from_runs_over_the_limit(build):
    campaign = build(runs=60, failed=(3, 7))
    campaign.metrics["delta_v_m_s"][:2] = 5.0
    entry = {"metric": "delta_v_m_s", "bound": "at most", "limit": 1.0, "probability": 0.9, "consumer_risk": 0.1}
    campaign.info["scenario"]["requirements"] = [entry]
    words = page_text(rendered_page(campaign))
    assert "2 over the limit 1 m/s" in words
    assert "2 failed and have no value" in words
    assert "(2 beyond the limit, 2 without a value)" in words
    keeps = np.sort(np.where(np.isnan(values := campaign.metrics["delta_v_m_s"]), np.inf, values))
    entry = report_json.report_content(campaign, [])["requirements"][0]
    assert entry["order_statistic"] == keeps[entry["rank"] - 1]
    sign = "+" if entry["order_statistic"] <= 1.0 else "\N{MINUS SIGN}"
    assert f"90 % keep {format_number(entry['order_statistic'], 3)} m/s: margin {sign}" in words
    duration = campaign.info["scenario"]["duration_s"]
    assert f": 60 runs, {duration:g} s each, seed 1" in words
    assert "\N{DAGGER} of the runs with a value alone" in words
    assert f"{np.nanmax(campaign.metrics['delta_v_m_s']):.0f}\N{DAGGER}" in words


def test_statistics_of_complete_campaigns_have_no_dagger(build):
    assert "\N{DAGGER}" not in page_text(rendered_page(build(runs=20))).partition("Monte Carlo campaign report")[2]
