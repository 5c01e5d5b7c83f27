"""The first screen: headline, cards, figures and what to change, from entries of report.json written by hand."""

import copy

import numpy as np
import pytest
from report_page_parser import page_text, rendered_page

from rpojax.report.labels import format_number
from rpojax.report.page import report_json
from rpojax.report.page.first_screen import leading_figures, verdict_tiles
from rpojax.report.page.headline import entry_margin, headline, headline_notes, weakest_requirement
from rpojax.report.page.next_steps import next_steps
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
        "without_value_text": "",
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


def test_headline_without_failures_is_the_verdicts_and_what_is_worst():
    assert headline(CONTENT) == [
        "None of 500 runs failed, and its 3 requirements are verified.",
        "After a loss of thrust 194 of 500 runs could drift into the keep-out sphere within 24 h.",
    ]
    safe = copy.deepcopy(CONTENT)
    safe["safety"]["free_drift"][1]["below_keep_out"]["count"] = 0
    assert (
        headline(safe)[1]
        == "The smallest margin is 0.150 m, of Relative navigation error \N{LESS-THAN OR EQUAL TO} 1.5 m."
    )
    safe["requirements"][0] |= {"verdict": "needs more runs", "more_runs": 30}
    assert headline(safe) == [
        "None of 500 runs failed, and of 3 requirements 2 are verified and 1 needs more runs.",
        "1 requirement needs more runs: no run violates too much, but 500 are too few to tell.",
    ]
    safe["requirements"][1] |= {"verdict": "not verified", "violations": 9}
    every = "None of 500 runs failed, and of 3 requirements 1 is verified, 1 is violated and 1 needs more runs."
    assert headline(safe)[0] == every
    assert headline(safe)[1] == "9 of 500 runs violate Minimum range \N{GREATER-THAN OR EQUAL TO} 15 m."


@pytest.mark.parametrize(
    ("verdict", "words"),
    [
        ("verified", "its requirement is verified."),
        ("not verified", "its requirement is violated."),
        ("needs more runs", "its requirement needs more runs."),
        ("unfinished: no verdict", "its requirement has no verdict."),
    ],
)
def test_what_is_open_is_told_apart_from_what_is_refuted(verdict, words):
    more = 30 if verdict == "needs more runs" else None
    entry = requirement("delta_v_m_s", "at most", 1.0, verdict, None, 0.5, more_runs=more)
    stated = {**CONTENT, "requirements": [entry]}
    assert headline(stated)[0] == f"None of 500 runs failed, {'but' if 'violated' in words else 'and'} {words}"


def test_headline_of_failures_is_how_many_and_the_main_cause():
    failed = ended(478, lost=15, off_station=7)
    cause = {"name": "wheels", "title": "wheels are saturated", "text": "a wheel reaches its greatest speed (100 %)"}
    cause |= {"mend": "larger wheels", "runs": 20, "run_ids": list(range(20)), "at_s": 1.0}
    failed["why_failed"] |= {"failed": 22, "causes": [cause], "without": 2}
    assert headline(failed) == [
        "22 of 500 runs failed: 15 lost the target, 7 off station.",
        "The main cause, in 20 of these: wheels are saturated.",
    ]
    failed["why_failed"]["causes"][0]["runs"] = 22
    assert headline(failed)[1] == "The cause in all 22: wheels are saturated."
    everything = ended(0, lost=500)
    assert headline(everything) == [
        "All 500 runs failed: lost the target.",
        "No cause was found: repeat one of them to look at it.",
    ]
    assert headline({**everything, "runs": everything["runs"] | {"missing": 500}}) == ["No run has ended yet."]


def ended(completed, **outcomes):
    """The content of 500 runs that ended so, those that are unfinished in the phase `near`."""
    found = copy.deepcopy(CONTENT)
    not_judged = outcomes.get("not_judged", 0)
    counts = {"completed": completed, "failed": 500 - completed - not_judged, "not_judged": not_judged}
    found["runs"] |= counts | {"outcomes": {**dict.fromkeys(map(str, Outcome), 0), "completed": completed, **outcomes}}
    detail = "stayed in near: range_sigma_m not met"
    found["failures"] = [{"run_id": run, "detail": detail} for run in range(outcomes.get("unfinished", 0))]
    return found


def test_the_headline_says_where_unfinished_runs_stayed():
    missed = ended(140, unfinished=360)
    assert headline(missed) == [
        "360 of 500 runs failed: the goal of the mission was not reached.",
        "No cause was found; stayed in near: range_sigma_m not met.",
    ]
    [tile] = [tile for tile in verdict_tiles(missed) if tile.title == "Failed runs"]
    assert (tile.value, tile.note, tile.css_class) == (
        "360 of 500",
        "360 unfinished; stayed in near: range_sigma_m not met",
        "alert",
    )


@pytest.mark.parametrize(
    ("completed", "not_judged", "words"),
    [
        (0, 500, "No run is judged, as all end before limits.arrive_by_s, and its 3 requirements are verified."),
        (490, 10, "10 of 500 runs are not judged, as they end before limits.arrive_by_s, and its 3 requirements are "),
    ],
)
def test_runs_that_are_not_judged_are_no_success_on_the_first_screen(completed, not_judged, words):
    content = ended(completed, not_judged=not_judged)
    assert headline(content)[0].startswith(words)
    assert not any("failed" in sentence for sentence in headline(content))
    tiles = {tile.title: (tile.value, tile.css_class) for tile in verdict_tiles(content)}
    assert tiles["Failed runs"] == ("0 of 500", "open")
    assert tiles["Runs not judged"] == (f"{not_judged} of 500", "open")


def test_what_qualifies_the_headline_stands_below_it():
    found = ended(480, lost=10, not_judged=10) | {"provenance": {"sealed": False, "requirement_changes": [{}, {}]}}
    assert headline_notes(found) == [
        "10 of 500 runs are not judged, as they end before limits.arrive_by_s.",
        "The folder is unsealed, so there are figures and no verdicts.",
        "Requirements were changed after the campaign (2 times, see limits of use).",
    ]
    assert headline_notes(CONTENT) == []


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


def test_a_requirement_that_is_passive_safety_is_one_card():
    stated = copy.deepcopy(CONTENT)
    stated["safety"]["keep_out_m"] = 10.0
    drift = requirement("passive_range_24_h_m", "at least", 10.0, "not verified", -9.5, 0.5, violations=194)
    stated["requirements"].append(drift)
    titles = [tile.title for tile in verdict_tiles(stated)]
    assert titles[0] == "Passive safety: passive range, 24 h \N{GREATER-THAN OR EQUAL TO} 10 m"
    assert sum("assive" in title for title in titles) == 1
    # Another limit is another fact.
    drift["limit"] = 25.0
    assert sum("assive" in tile.title for tile in verdict_tiles(stated)) == 2


def test_a_tolerance_bound_is_told_apart_from_a_percentile_of_the_sample():
    stated = copy.deepcopy(CONTENT)
    stated["requirements"][0] |= {"order_statistic": 1.26, "sample_percentile": 1.056}
    [tile] = [tile for tile in verdict_tiles(stated) if tile.title.startswith("Formation")]
    assert "; tolerance bound 1.26 m at 10 % risk: margin +0.900 m; sample p99 1.06 m" in tile.note


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
    ("change", "what", "words"),
    [
        (
            {"verdict": "not verified", "violations": 9, "violating_ids": [3]},
            "Violated: Formation error \N{LESS-THAN OR EQUAL TO} 2 m",
            "9 of 500 violate it",
        ),
        (
            {"verdict": "needs more runs", "more_runs": 30},
            "1 requirement needs more runs",
            "simulate at least 530 as a new campaign with another seed",
        ),
    ],
)
def test_rows_on_what_to_change_follow_from_what_was_found(campaign, change, what, words):
    content = copy.deepcopy(CONTENT)
    content["requirements"][0] |= change
    steps = next_steps(campaign, content)
    assert (steps[0].what, steps[0].run_id) == ("194 of 500 runs are not passively safe", 7)
    assert "run 7" in steps[0].why
    assert steps[1].what == "12 of 500 runs are not safe from a burn that does not end"
    [step] = [step for step in steps if step.what == what]
    assert words in step.text
    assert all(step.command.startswith("rpojax ") for step in steps)


def test_more_runs_are_no_advice_where_runs_fail_or_there_is_one(campaign):
    content = ended(499, lost=1)
    content["requirements"][0] |= {"verdict": "needs more runs", "more_runs": 30}
    content["failures"] = [{"run_id": 3, "detail": ""}]
    assert not any("more runs" in step.what for step in next_steps(campaign, content))
    one = copy.deepcopy(CONTENT)
    one["runs"] |= {"requested": 1, "completed": 1}
    one["requirements"][0] |= {"verdict": "needs more runs", "more_runs": 229}
    assert not any("more runs" in step.what for step in next_steps(campaign, one))


def test_a_requirement_that_only_failed_runs_violate_has_no_row_of_its_own(campaign):
    content = ended(497, lost=3)
    content["failures"] = [{"run_id": run, "detail": ""} for run in (3, 4, 5)]
    violated = {"verdict": "not verified", "violations": 3, "violating_ids": [3, 4, 5]}
    content["requirements"][0] |= violated
    steps = next_steps(campaign, content)
    assert steps[0].what == "All 3 failed runs"
    assert not any(step.what.startswith("Violated") for step in steps)
    content["requirements"][0] |= {"violations": 4, "violating_ids": [3, 4, 5, 6]}
    assert any(step.run_id == 6 for step in next_steps(campaign, content))


def test_the_run_to_look_at_is_one_beyond_the_limit_and_not_one_that_failed(campaign):
    content = copy.deepcopy(CONTENT)
    violated = {"verdict": "not verified", "violations": 3, "violating_ids": [3, 7, 12], "without_value": 2}
    content["requirements"][0] |= {**violated, "beyond_limit": 1, "without_value_text": "2 off station"}
    assert "--run-id 12 " in next(step.command for step in next_steps(campaign, content) if "Violated" in step.what)
    content["requirements"][0] |= {"violating_ids": [3, 7], "violations": 2, "beyond_limit": 0}
    assert "--run-id 3 " in next(step.command for step in next_steps(campaign, content) if "Violated" in step.what)


def test_failed_runs_without_a_value_are_told_apart_from_runs_over_the_limit(build):
    campaign = build(runs=60, failed=(3, 7))
    campaign.metrics["delta_v_m_s"][:2] = 5.0
    entry = {"metric": "delta_v_m_s", "bound": "at most", "limit": 1.0, "probability": 0.9, "consumer_risk": 0.1}
    campaign.info["scenario"]["requirements"] = [entry]
    words = page_text(rendered_page(campaign))
    assert "2 over the limit 1 m/s" in words
    assert "2 failed and have no value" in words
    assert "4 of 60 violate it, 2 of them without a value" in words
    assert "worst no value (2 " in words
    keeps = np.sort(np.where(np.isnan(values := campaign.metrics["delta_v_m_s"]), np.inf, values))
    entry = report_json.report_content(campaign, [])["requirements"][0]
    assert entry["order_statistic"] == keeps[entry["rank"] - 1]
    sign = "+" if entry["order_statistic"] <= 1.0 else "\N{MINUS SIGN}"
    bound = format_number(entry["order_statistic"], 3)
    assert f"tolerance bound {bound} m/s at 10 % risk: margin {sign}" in words
    sample = np.nanpercentile(campaign.metrics["delta_v_m_s"], 90.0)
    assert f"sample p90 {format_number(sample, 3)} m/s" in words
    duration = campaign.info["scenario"]["duration_s"]
    assert f": 60 runs, {duration:g} s each, seed 1" in words
    assert "\N{DAGGER} of the runs with a value alone" in words
    assert f"{np.nanmax(campaign.metrics['delta_v_m_s']):.0f}\N{DAGGER}" in words


def test_statistics_of_complete_campaigns_have_no_dagger(build):
    assert "\N{DAGGER}" not in page_text(rendered_page(build(runs=20))).partition("Monte Carlo campaign report")[2]


def test_more_runs_are_not_asked_for_where_so_many_violate_that_they_would_not_verify():
    stated = copy.deepcopy(CONTENT)
    for drift in stated["safety"]["free_drift"]:
        drift["below_keep_out"]["count"] = 0
    few = {"verdict": "needs more runs", "violations": 2, "violating_ids": [1, 2], "runs": 100, "more_runs": None}
    stated["requirements"][0] |= few
    limit = "Formation error \N{LESS-THAN OR EQUAL TO} 2 m"
    assert headline(stated) == [
        "None of 500 runs failed, and of 3 requirements 2 are verified and 1 is open.",
        f"2 of 100 runs violate {limit}: too few to refute it, too many for more runs to verify it.",
    ]


def test_more_runs_are_not_asked_for_where_all_failed_and_few_have_an_interval(build):
    campaign = build(runs=8, failed=())
    campaign.outcomes[:] = str(Outcome.ABORTED)
    campaign.completed[:], campaign.failed[:] = False, True
    entry = {"metric": "delta_v_m_s", "bound": "at most", "limit": 1e6, "probability": 0.99, "consumer_risk": 0.1}
    campaign.info["scenario"]["requirements"] = [entry, {**entry, "limit": 0.0}]
    kept, broken = report_json.report_content(campaign, [])["requirements"]
    assert (kept["verdict_text"], kept["more_runs"]) == ("open: all runs failed", None)
    assert (broken["verdict"], broken["verdict_text"]) == ("not verified", "violated")
    assert headline(report_json.report_content(campaign, []))[0] == "All 8 runs failed (95 %: 63 to 100 %): aborted."


def test_a_violated_drift_is_told_as_passive_safety_beside_the_requirements():
    stated = copy.deepcopy(CONTENT)
    drift = requirement("passive_range_24_h_m", "at least", 10.0, "not verified", -9.5, 0.5, violations=498)
    stated["requirements"].append(drift)
    assert headline(stated) == [
        "None of 500 runs failed, but 1 of 4 requirements is violated.",
        "498 of 500 runs are not passively safe: without thrust they could drift to within 10 m in 24 h.",
    ]


def test_a_drift_into_the_target_hits_it(campaign):
    content = copy.deepcopy(CONTENT)
    content["safety"] |= {"target_radius_m": 0.25}
    content["safety"]["free_drift"][1]["least_range"]["value"] = 0.00129
    assert "nearest 0.001 m, which hits the target, run 7" in next_steps(campaign, content)[0].why
    assert "nearest 0.001 m, which hits the target, run 7" in verdict_tiles(content)[0].note


def test_terms_of_the_first_screen_have_their_meaning(build):
    campaign = build(runs=8, failed=())
    campaign.outcomes[:2] = str(Outcome.OFF_STATION)
    campaign.completed[:2], campaign.failed[:2] = False, True
    page = campaign.directory / "report.html"
    rendered_page(campaign)
    assert '<abbr title="farther from its place than limits.off_station_m' in page.read_text(encoding="utf-8")


def test_what_only_failed_runs_with_a_cause_show_follows_from_it(build):
    campaign = build(runs=8, failed=())
    campaign.metrics["nees_relative_mean"] = np.where(np.arange(8) < 3, 6e7, 6.0)
    campaign.metrics["formation_error_rms_m"] = np.where(np.isin(np.arange(8), (0, 2)), 2.5, 0.5)
    content = ended(497, lost=3) | {"warnings": [], "metrics": {"nees_relative_mean": {"mean": 2.2e7}}}
    content["failures"] = [{"run_id": run, "detail": ""} for run in (0, 1, 2)]
    cause = {"name": "misses", "title": "boxes are missing", "text": "", "mend": "", "runs": 3, "run_ids": [0, 1, 2]}
    before = campaign.metrics["formation_error_rms_m"].copy()
    content["why_failed"] |= {"failed": 3, "causes": [cause]}
    violated = {"verdict": "not verified", "violations": 2, "beyond_limit": 2, "violating_ids": [0, 2], "worst": 2.5}
    content["requirements"][0] |= violated
    steps = {step.what: step for step in next_steps(campaign, content)}
    limit = "Formation error \N{LESS-THAN OR EQUAL TO} 2 m"
    consequence = steps["A requirement is violated, too"]
    assert consequence.why == f"{limit} (2 of 500, worst 2.50 m): only by runs that failed by a cause above"
    assert consequence.change == "follows from that cause: mend it first"
    # Neither where a run without a value violates it, too, that has no cause, nor by a cause that has no row.
    campaign.metrics["formation_error_rms_m"][4] = np.nan
    assert "A requirement is violated, too" not in {step.what for step in next_steps(campaign, content)}
    campaign.metrics["formation_error_rms_m"] = before
    hidden = [{**cause, "run_ids": [run]} for run in (10, 11, 12)]
    content["why_failed"]["causes"] = [*hidden, cause]
    assert "A requirement is violated, too" not in {step.what for step in next_steps(campaign, content)}
    content["why_failed"]["causes"] = [cause]
    filter_row = steps["The filter is overconfident"]
    assert "only in 3 runs that failed" in filter_row.why
    assert filter_row.change == "follows from that cause: mend it first"
    # A run that did not fail shows it, too: the belief that the scenario contradicts is named.
    campaign.metrics["nees_relative_mean"][5] = 60.0
    belief = "navigation.edge_noise_px: the filter believes 1, the truth is 6 by camera.edge_noise_px"
    steps = {step.what: step for step in next_steps(campaign, content | {"warnings": [belief]})}
    assert steps["The filter is overconfident"].change.startswith("navigation.edge_noise_px, which")
