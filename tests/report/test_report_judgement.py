"""Requirements, safety, failures and worst runs of made-up campaigns, in report.json and on the page."""

import json
from typing import Any

import numpy as np
import pytest

from rpojax.errors import ResultError
from rpojax.report.page.campaign_summary import summarise
from rpojax.report.page.html_report import write_report
from rpojax.report.page.report_json import report_content
from rpojax.report.sections import failure_section, requirement_verdict_section, safety_section, worst_runs_section


def _require(campaign: Any, **changes: Any) -> dict[str, Any]:
    """Judgement of one requirement, by default that the velocity change is at most 1 m/s."""
    usual = {"metric": "delta_v_m_s", "bound": "at most", "limit": 1.0, "probability": 0.99, "consumer_risk": 0.1}
    campaign.info["scenario"]["requirements"] = [{**usual, **changes}]
    return summarise(campaign)["requirements"][0]


def _intervals(value: Any, path: str = "") -> dict[str, Any]:
    """Everything in `value` that only independent runs allow to say, by its place."""
    if isinstance(value, dict):
        named = {f"{path}.{key}": item for key, item in value.items() if _needs_independence(str(key))}
        return named | {k: v for key, item in value.items() for k, v in _intervals(item, f"{path}.{key}").items()}
    if isinstance(value, list):
        return {k: v for index, item in enumerate(value) for k, v in _intervals(item, f"{path}[{index}]").items()}
    return {}


def _needs_independence(key: str) -> bool:
    ends = ("interval_95", "_p", "low_95", "high_95", "lower_95", "upper_95")
    return key.endswith(ends) or key in ("p", "success_interval", "risk_reached", "rank")


def test_a_requirement_is_verified_with_its_order_statistic_margin_and_risk(build):
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
    ("runs", "limit", "verdict"), [(230, 1.0, "verified"), (200, 1.0, "needs 30 more runs"), (200, 0.3, "not verified")]
)
def test_verdicts_in_words(build, runs, limit, verdict):
    campaign = build(runs=runs, seconds=30, kept=())
    found = _require(campaign, limit=limit)
    assert found["verdict_text"] == verdict
    row = requirement_verdict_section.rows([found])[0]
    assert row.verdict == verdict
    assert row.css_class == {"verified": "good", "not verified": "alert"}.get(verdict, "open")
    assert row.title == f"Delta-v \N{LESS-THAN OR EQUAL TO} {limit:g} m/s"


def test_a_failed_run_violates_every_requirement_and_can_be_flown_again(build):
    campaign = build(runs=12, seconds=30, kept=(), failed=(4,))
    found = _require(campaign, metric="min_range_m", bound="at least", limit=1.0)
    assert (found["violations"], found["violating_ids"], found["without_value"]) == (1, [4], 1)
    assert requirement_verdict_section.rows([found])[0].cells[0][1] == "of 11 runs with a value"
    page = write_report(campaign).read_text()
    assert f"rpojax rerun {campaign.directory} --run-id 4 --out run_4" in page
    assert "Minimum range \N{GREATER-THAN OR EQUAL TO} 1 m" in page


@pytest.mark.parametrize("limit", [1.0, 0.3])
def test_with_missing_runs_nothing_is_verified_nor_refuted(build, limit):
    # The 388 runs at hand would verify the first and refute the second.
    campaign = build(runs=388, seconds=30, kept=())
    campaign.info["runs"] = 400
    found = _require(campaign, limit=limit)
    assert (found["verdict"], found["verdict_text"]) == ("unfinished: no verdict",) * 2
    silent = ("more_runs", "allowed", "rank", "order_statistic", "margin", "success_interval", "risk_reached")
    assert {found[key] for key in silent} == {None}
    row = requirement_verdict_section.rows([found])[0]
    assert (row.verdict, row.css_class, row.cells[3][1]) == ("unfinished: no verdict", "open", "unfinished")
    assert "no verdict before all have ended" in write_report(campaign).read_text()


def test_a_probability_is_never_rounded_up_to_what_is_asked():
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
        "without_value": 1,
        "worst": 2.0,
        "success": 0.98999,
        "success_interval": [0.98955, 0.99034],
        "risk_reached": 0.5,
        "violating_ids": [],
    }
    cells = requirement_verdict_section.rows([entry])[0].cells
    assert cells[0] == ("2", "of 99999 runs with a value")
    assert cells[4] == ("0.9899", "0.9895 to 0.9904")
    assert cells[2] == ("-0.1000", "")


def test_a_requirement_on_what_the_campaign_has_not_is_refused(build):
    campaign = build(runs=12, seconds=30, kept=())
    with pytest.raises(ResultError, match=r"requirements\[0\]: found no metric 'passive_range_m'"):
        _require(campaign, metric="passive_range_m")
    with pytest.raises(ResultError, match=r"requirements\[0\]: found .*, expected a requirement"):
        _require(campaign, limit="one")


@pytest.mark.parametrize("kind", ["latin_hypercube", "sobol"])
def test_runs_that_are_not_independent_get_labels_in_place_of_intervals_and_verdicts(build, kind):
    campaign = build(runs=300, seconds=300, kept=(), failed=(1, 2, 3, 50, 60))
    assert any(value is not None for value in _intervals(report_content(campaign)).values())
    campaign.info["scenario"]["design"] = {"kind": kind}
    found = _require(campaign)
    assert found["verdict"] == "not independent: no verdict"
    path = write_report(campaign)
    content = json.loads((campaign.directory / "report.json").read_text())
    assert content["design"] == {"kind": kind, "independent": False}
    stated = {place: value for place, value in _intervals(content).items() if value is not None}
    assert stated == {}
    assert {entry["says"] for entry in content["consistency"]["means"]} == {"Nothing, as the runs are not independent."}
    assert any("are not independent of one another" in sentence for sentence in content["limits"])
    assert "so there is no rank, no interval and no verdict" in path.read_text()


def test_the_least_range_counts_what_a_failed_run_came_to_before_it_failed(build):
    campaign = build(runs=30, seconds=300, kept=(), failed=(5,))
    campaign.traces["range_m"][5, 3] = 9.5
    campaign.metrics["passive_range_m"] = np.where(np.arange(30) < 2, 8.0, 20.0)
    campaign.metrics["passive_range_m"][5] = np.nan
    found = safety_section.content(campaign)
    assert found["least_range"] == {"value": 9.5, "run_id": 5, "at_most": False}
    assert found["entries"]["run_ids"] == [5]
    # Clopper and Pearson for one of thirty: the ends solve the two binomial tails for 2.5 %.
    low, high = found["entries"]["interval_95"]
    assert 1.0 - (1.0 - low) ** 30 == pytest.approx(0.025)
    assert (1.0 - high) ** 30 + 30 * high * (1.0 - high) ** 29 == pytest.approx(0.025)
    assert (found["passive_below_keep_out"]["count"], found["passive_below_keep_out"]["runs"]) == (3, 30)
    assert found["least_passive_range"] == {"value": 8.0, "run_id": 0}
    assert found["longest_look_away"] is None


def test_the_least_range_of_a_run_that_entered_the_sphere_is_at_most_its_radius(build):
    campaign = build(runs=30, seconds=300, kept=(), failed=(5,))
    found = safety_section.content(campaign)
    assert np.nanmin(campaign.traces["range_m"]) > 10.0
    assert found["least_range"] == {"value": 10.0, "run_id": 5, "at_most": True}
    assert safety_section.rows(found)[0] == ("Least range of any run", "at most 10 m", "run 5")
    campaign.info["scenario"]["limits"] = {}
    assert safety_section.content(campaign)["least_range"]["at_most"] is False


def test_what_sets_failing_runs_apart_is_named_by_reason(build):
    failed = tuple(range(0, 60, 3))
    campaign = build(runs=200, seconds=60, kept=(), failed=failed)
    campaign.drawn["gps.noise_m"][list(failed)] += 5.0
    campaign.failure_reason[0] = "non-finite state"
    found = failure_section.content(campaign)
    assert [(one["reason"], one["runs"]) for one in found] == [
        ("entered the keep-out sphere", 19),
        ("non-finite state", 1),
    ]
    first = found[0]["inputs"][0]
    assert (first["input"], first["ks"], first["auc"]) == ("gps.noise_m", 1.0, 1.0)
    assert first["ks_p"] < 1e-6
    assert failure_section.cause_sentence(found[0]).endswith("beyond chance: gps.noise_m.")
    assert failure_section.cause_rows(found[0])[0][:2] == ["gps.noise_m", "greater"]
    # One run alone proves nothing: its rank among 181 has at best a p-value of about 0.01, times five inputs.
    assert (
        failure_section.cause_sentence(found[1]) == "No input sets these runs apart from completed ones beyond chance."
    )


def test_the_five_worst_runs_of_each_leading_metric_on_the_bad_side(build):
    campaign = build(runs=30, seconds=60, kept=(), failed=(7,))
    campaign.metrics["min_range_m"] = np.linspace(20.0, 30.0, 30)
    found = {
        entry["metric"]: [run["run_id"] for run in entry["runs"]] for entry in worst_runs_section.content(campaign)
    }
    assert found["min_range_m"] == [0, 1, 2, 3, 4]
    expected = np.argsort(-np.nan_to_num(campaign.metrics["delta_v_m_s"], nan=-1.0))[:5]
    assert found["delta_v_m_s"] == expected.tolist()
    rows = worst_runs_section.rows(worst_runs_section.content(campaign))
    assert "Minimum range 20 m (worst)" in dict(rows)[0]
    assert len(rows[0][1]) == max(len(places) for _, places in rows)
