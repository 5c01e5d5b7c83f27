"""Requirement verdicts of synthetic campaigns, in report.json and on the page."""

from typing import Any

import numpy as np
import pytest

from rpojax.errors import ResultError
from rpojax.report.labels import format_number, with_unit
from rpojax.report.page.html_report import write_report
from rpojax.report.page.report_json import summarise
from rpojax.report.sections import requirement_verdict_section
from rpojax.simulation.outcomes.outcome_kinds import Outcome


def _require(campaign: Any, **changes: Any) -> dict[str, Any]:
    """Verdict on one requirement, by default that the velocity change is at most 1 m/s."""
    usual = {"metric": "delta_v_m_s", "bound": "at most", "limit": 1.0, "probability": 0.99, "consumer_risk": 0.1}
    campaign.info["scenario"]["requirements"] = [{**usual, **changes}]
    return summarise(campaign)["requirements"][0]


def test_verified_requirement_has_order_statistic_margin_and_risk(build):
    # 388 runs verify 0.99 at a risk of 0.1 with one violation: the run of rank 387 is compared with the limit.
    campaign = build(runs=388, seconds=30, kept=())
    ranked = np.sort(campaign.metrics["delta_v_m_s"])
    limit = float(ranked[-1] + ranked[-2]) / 2.0
    found = _require(campaign, limit=limit)
    assert found["verdict"] == "verified"
    assert (found["rank"], found["allowed"], found["violations"]) == (387, 1, 1)
    assert found["order_statistic"] == ranked[-2]
    assert found["margin"] == pytest.approx(limit - ranked[-2])
    assert found["worst"] == ranked[-1]
    assert found["violating_ids"] == [int(np.argmax(campaign.metrics["delta_v_m_s"]))]
    assert found["success_interval"][0] >= 0.99
    assert found["risk_reached"] <= 0.1
    assert found["text"].startswith("Delta-v at most ")


@pytest.mark.parametrize(
    ("runs", "limit", "verdict"), [(230, 1.0, "verified"), (200, 1.0, "needs 30 more runs"), (200, 0.3, "violated")]
)
def test_verdict_texts_and_colours(build, runs, limit, verdict):
    campaign = build(runs=runs, seconds=30, kept=())
    found = _require(campaign, limit=limit)
    assert found["verdict_text"] == verdict
    row = requirement_verdict_section.rows([found])[0]
    assert row.verdict == verdict
    assert row.css_class == {"verified": "good", "violated": "alert"}.get(verdict, "open")
    assert row.title == f"Delta-v \N{LESS-THAN OR EQUAL TO} {limit:g} m/s"


def test_runs_that_do_not_count_are_told_apart(build):
    campaign = build(runs=300, seconds=30, kept=())
    name, there = "delta_v_m_s@approach", np.arange(300) % 3 > 0
    campaign.metrics[name] = np.where(there, campaign.metrics["delta_v_m_s"], np.nan)
    campaign.metrics["duration_s@approach"] = np.where(there, 10.0, 0.0)
    found = _require(campaign, phase="approach", probability=0.98, among="reaching_runs")
    assert (found["of"], found["runs"], found["not_counted"], found["violations"]) == (name, 200, 100, 0)
    assert found["verdict"] == "verified"
    assert found["text"] == "Delta-v in approach at most 1 m/s in at least 98 % of runs that reach approach"
    row = requirement_verdict_section.rows([found])[0]
    assert row.title.startswith("Delta-v in approach ")
    assert "100 do not count" in row.note
    assert "200 of 300 reached approach" in row.note
    page = write_report(campaign).read_text()
    assert "100 do not count" in page
    assert "200 of 300 reached approach" in page


def test_runs_that_never_reach_the_phase_of_a_requirement_violate_it(build):
    campaign = build(runs=300, seconds=30, kept=())
    name, there = "delta_v_m_s@approach", np.arange(300) % 3 > 0
    # Totals of no ticks are 0, which would keep the limit.
    campaign.metrics[name] = np.where(there, campaign.metrics["delta_v_m_s"], 0.0)
    campaign.metrics["duration_s@approach"] = np.where(there, 10.0, 0.0)
    found = _require(campaign, phase="approach", probability=0.98)
    assert (found["runs"], found["not_counted"], found["violations"], found["without_value"]) == (300, 0, 100, 100)
    assert (found["verdict"], found["reached"], found["reached_text"]) == (
        "not verified",
        200,
        "200 of 300 reached approach",
    )
    assert found["text"] == "Delta-v in approach at most 1 m/s in at least 98 % of runs"
    # A verdict on those that reach it needs one that does.
    campaign.metrics["duration_s@approach"][:] = 0.0
    found = _require(campaign, phase="approach", probability=0.98)
    assert (found["verdict"], found["reached"], found["violations"]) == ("not verified", 0, 300)
    found = _require(campaign, phase="approach", probability=0.98, among="reaching_runs")
    assert (found["verdict"], found["runs"], found["not_counted"]) == ("no run counts: no verdict", 0, 300)
    campaign.metrics[f"{name}.end"] = np.full(300, 0.1)
    campaign.metrics["event_time_s@approach.end"] = np.where(np.arange(300) < 4, 20.0, np.nan)
    found = _require(campaign, phase="approach", at="end", probability=0.98)
    assert found["reached_text"] == "4 of 300 came to the end of approach"


def test_a_requirement_on_an_outcome_counts_its_runs(build):
    campaign = build(runs=12, seconds=30, kept=(), failed=(4,))
    outcome = str(campaign.outcomes[4])
    found = _require(campaign, outcome=outcome)
    assert (found["runs"], found["not_counted"], found["violating_ids"]) == (1, 11, [4])
    assert found["text"].endswith(f"of runs that end as {outcome}")
    assert _require(campaign).keys().isdisjoint({"of", "not_counted", "outcome", "phase"})


def test_failed_run_violates_every_requirement_and_has_a_rerun_command(build):
    campaign = build(runs=12, seconds=30, kept=(), failed=(4,))
    found = _require(campaign, metric="min_range_m", bound="at least", limit=1.0)
    assert (found["violations"], found["violating_ids"], found["without_value"]) == (1, [4], 1)
    assert requirement_verdict_section.rows([found])[0].cells[0][0] == "no value"
    page = write_report(campaign).read_text()
    assert f"rpojax rerun {campaign.directory} --run-id 4 --out run_4" in page
    assert "Minimum range \N{GREATER-THAN OR EQUAL TO} 1 m" in page


@pytest.mark.parametrize("limit", [1.0, 0.3])
def test_no_verdict_with_missing_runs(build, limit):
    # The 388 runs at hand would verify the first and refute the second.
    campaign = build(runs=388, seconds=30, kept=())
    campaign.info["runs"] = 400
    found = _require(campaign, limit=limit)
    assert (found["verdict"], found["verdict_text"]) == ("unfinished: no verdict",) * 2
    silent = ("more_runs", "allowed", "rank", "order_statistic", "margin", "success_interval", "risk_reached")
    assert {found[key] for key in silent} == {None}
    row = requirement_verdict_section.rows([found])[0]
    assert (row.verdict, row.css_class, row.cells[4][1]) == ("unfinished: no verdict", "open", "unfinished")
    assert "no verdict before all have ended" in write_report(campaign).read_text()


def test_probabilities_are_not_rounded_up_to_the_required_one():
    entry = {
        "metric": "delta_v_m_s",
        "bound": "at most",
        "limit": 1.0,
        "probability": 0.99,
        "consumer_risk": 0.1,
        "text": "",
        "verdict": "needs more runs",
        "verdict_text": "",
        "runs": 100000,
        "violations": 1001,
        "allowed": 900,
        "rank": 99100,
        "order_statistic": 1.1,
        "margin": -0.1,
        "beyond_limit": 1000,
        "without_value": 1,
        "without_value_text": "1 lost the target",
        "worst": 2.0,
        "success": 0.98999,
        "success_interval": [0.98955, 0.99034],
        "risk_reached": 0.5,
        "violating_ids": [],
    }
    cells = requirement_verdict_section.rows([entry])[0].cells
    assert cells[0] == ("no value", "1 lost the target; of the others 2")
    assert cells[4] == ("1001 of 100000", "1 of them without a value; 900 allowed")
    assert cells[5] == ("0.9899", "0.9895 to 0.9904")
    assert cells[3] == ("\N{MINUS SIGN}0.1000", "")


def test_runs_without_a_value_alone_are_named_and_not_the_limit(build):
    campaign = build(runs=12, seconds=30, kept=(), failed=(2, 4, 7))
    kept = _require(campaign, metric="min_range_m", bound="at least", limit=1.0)
    assert (kept["verdict"], kept["beyond_limit"], kept["verdict_text"]) == ("not verified", 0, "3 without a value")
    broken = _require(campaign, metric="min_range_m", bound="at least", limit=1e6)
    assert (broken["beyond_limit"], broken["verdict_text"]) == (9, "violated")


def test_unknown_metric_and_invalid_requirement_are_errors(build):
    campaign = build(runs=12, seconds=30, kept=())
    with pytest.raises(ResultError, match=r"requirements\[0\]: found no metric 'passive_range_m'"):
        _require(campaign, metric="passive_range_m")
    with pytest.raises(ResultError, match=r"requirements\[0\]: found .*, expected a requirement"):
        _require(campaign, limit="one")


def test_a_failed_run_without_a_value_is_the_worst(build):
    campaign = build(runs=8, failed=(2,))
    entry = {"metric": "min_range_m", "bound": "at least", "limit": 1e6, "probability": 0.9, "consumer_risk": 0.1}
    campaign.info["scenario"]["requirements"] = [entry]
    [found] = requirement_verdict_section.content(campaign, 0)
    kind = Outcome(str(campaign.outcomes[2]))
    worst = with_unit(format_number(np.nanmin(campaign.metrics["min_range_m"]), 3), "m")
    assert found["without_value_text"] == f"1 {kind.reason}"
    assert requirement_verdict_section.worst_text(found) == f"no value (1 {kind.reason}), of the others {worst}"
    [row] = requirement_verdict_section.rows([found])
    assert "8 of 8 violate it, 1 of them without a value" in row.note
    assert row.cells[0][0] == "no value"
    assert f"1 {kind.reason}" in row.cells[0][1]
