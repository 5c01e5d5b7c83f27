"""The page on what changed: overlays, marked rows, differences of signed figures, warnings, and several campaigns."""

import json

import numpy as np
import plotly.graph_objects
import pytest
from report_page_parser import ReportPage, page_text
from synthetic_campaign_results import synthetic_campaign

from rpojax.analysis.statistics.campaign_comparison import CampaignComparison, KeyChange
from rpojax.analysis.statistics.paired_comparison import RunMetrics, compare_paired_runs
from rpojax.errors import ResultError
from rpojax.report.page.comparison_page import change_rows, write_comparison


def compared(campaigns, warnings=()):
    """Each of the campaigns but the first compared with the first."""
    runs = [RunMetrics(each.run_ids, each.outcomes, each.metrics) for each in campaigns]
    changed = (KeyChange("navigation.gate_sigma", 3.0, 4.0),)
    return [
        CampaignComparison(
            campaigns[0].directory,
            other.directory,
            changed,
            True,
            tuple(warnings),
            compare_paired_runs(runs[0], one, [], True),
        )
        for other, one in zip(campaigns[1:], runs[1:], strict=True)
    ]


@pytest.fixture
def three(tmp_path):
    campaigns = [synthetic_campaign(tmp_path / name, kept=()) for name in ("first", "second", "third")]
    campaigns[1].metrics["delta_v_m_s"] = 2.0 * campaigns[1].metrics["delta_v_m_s"]
    for number, campaign in enumerate(campaigns):
        campaign.metrics["gps_innovation_lag1"] = np.linspace(-0.1, 0.1, 40) + 0.01 * number
    return campaigns


def test_changed_rows_are_marked_and_come_first(three, tmp_path):
    page = ReportPage(write_comparison(three[:2], compared(three[:2]), tmp_path / "c.html").read_text())
    marked = [index for index, (tag, attributes) in enumerate(page.tags) if attributes.get("class") == "marked"]
    assert len(marked) == 2
    words = page_text(page)
    rows = words[words.index("Pairs Changed") :]
    assert rows.index("Delta-v") < rows.index("Formation error")
    assert "the median of 2 of 18 metrics changed (about 1 would seem to by chance)" in words


def test_changes_are_ranked_by_effect_in_words_and_colour(three, tmp_path):
    three[1].metrics["min_range_m"] = three[1].metrics["min_range_m"] + 1.0
    three[1].metrics["nees_mean"] = three[1].metrics["nees_mean"] + 4.0
    [found] = compared(three[:2])
    rows = [row for row in change_rows(found) if row.is_changed]
    told = {row.name: (row.direction, row.tone) for row in rows}
    assert told["delta_v_m_s"] == ("worse", "alert")
    assert told["min_range_m"] == ("better", "good")
    assert told["nees_mean"] == ("higher", "")
    names = [row.name for row in rows]
    assert names.index("delta_v_m_s") < names.index("nees_mean") < names.index("min_range_m")
    page = ReportPage(write_comparison(three[:2], [found], tmp_path / "c.html").read_text())
    placed = [str(attributes["data-chart"]) for _, attributes in page.tags if "data-chart" in attributes]
    assert placed[:2] == ["first-envelope-delta_v_m_s", "first-histogram-gps_innovation_lag1"]
    words = page_text(page)
    first_screen = words[words.index("Largest effects") : words.index("Changed key")]
    assert first_screen.index("worse") < first_screen.index("better")


def test_signed_figures_have_differences_and_no_ratio(three):
    [found] = compared(three[:2])
    by_name = {change.metric: change for change in found.runs.metrics}
    assert by_name["gps_innovation_lag1"].ratio.value is None
    assert by_name["gps_innovation_lag1"].difference.value == pytest.approx(0.01)
    assert by_name["delta_v_m_s"].ratio.value == pytest.approx(2.0)


def test_overlays_have_a_line_for_each_campaign(three, tmp_path):
    page = ReportPage(write_comparison(three, compared(three), tmp_path / "c.html").read_text())
    charts = json.loads(page.data)["charts"]
    placed = [str(attributes["data-chart"]) for _, attributes in page.tags if "data-chart" in attributes]
    assert sorted(placed) == sorted(charts)
    names = {"A: first", "B: second", "C: third"}
    assert {trace["name"] for trace in charts["histogram-delta_v_m_s"]["data"]} == names
    assert {f"{name}, median" for name in names} <= {trace["name"] for trace in charts["envelope-range_m"]["data"]}
    for chart in charts.values():
        plotly.graph_objects.Figure(chart)


def test_warnings_are_banners(three, tmp_path):
    found = compared(three[:2], ["durations differ, 600 s and 300 s"])
    words = page_text(ReportPage(write_comparison(three[:2], found, tmp_path / "c.html").read_text()))
    assert "Not like with like: durations differ, 600 s and 300 s." in words


def test_more_campaigns_than_colours_are_refused(three, tmp_path):
    with pytest.raises(ResultError, match="found 7 folders, expected at most 6"):
        write_comparison(three[:1] * 7, [], tmp_path / "c.html")
    assert not (tmp_path / "c.html").exists()


def test_with_few_pairs_nothing_is_said_of_chance_and_the_least_number_is(three, tmp_path):
    for campaign in three[:2]:
        for name, values in campaign.metrics.items():
            campaign.metrics[name] = np.where(np.arange(40) < 9, values, np.nan)
    words = page_text(ReportPage(write_comparison(three[:2], compared(three[:2]), tmp_path / "c.html").read_text()))
    assert "no interval for 18 metrics: it needs 10 pairs of runs" in words
    assert "by chance)" not in words
    assert "No median changed" not in words
    assert "no intervals: they need 10 pairs of runs" in str(compared(three[:2])[0])
