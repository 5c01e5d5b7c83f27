"""The brief report: four sheets, each with page number and hash."""

import json

import pytest
from report_page_parser import ReportPage, page_text

from rpojax.errors import ResultError
from rpojax.report.page.brief_page import write_brief


def test_four_sheets_each_with_page_number_and_hash(campaign):
    page = ReportPage(write_brief(campaign).read_text())
    assert sum(attributes.get("class") == "sheet" for _, attributes in page.tags) == 4
    words = page_text(page)
    for number in range(1, 5):
        assert f"scenario 3f6c0a9d51e2 · seed 1 · rpojax 0.1.0 · 2026-01-01 page {number} of 4" in words
    charts = json.loads(page.data)["charts"]
    assert {str(a["data-chart"]) for _, a in page.tags if "data-chart" in a} == set(charts)


def test_long_lists_are_cut_with_their_number(campaign):
    requirement = {"metric": "delta_v_m_s", "bound": "at most", "probability": 0.99, "consumer_risk": 0.1}
    campaign.info["scenario"]["requirements"] = [{**requirement, "limit": 1.0 + 0.1 * n} for n in range(13)]
    words = page_text(ReportPage(write_brief(campaign).read_text()))
    assert "3 more are in report.html." in words


def test_one_run_has_no_brief_report(build):
    with pytest.raises(ResultError, match="found one run, expected a campaign of several"):
        write_brief(build(runs=1))
