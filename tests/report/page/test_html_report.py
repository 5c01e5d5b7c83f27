"""The report page: self-contained, well formed, and explicit about what is missing."""

import json

import numpy as np
import plotly.graph_objects
import pytest
from report_page_parser import page_text, rendered_page

from rpojax.errors import OutputError, ResultError
from rpojax.report.page.html_report import write_report

_SECTIONS = {
    *(
        "outcome",
        "identity",
        "requirements",
        "headline",
        "metrics",
        "safety",
        "envelopes",
        "budgets",
        "consistency",
        "distributions",
    ),
    *("convergence", "dispersions", "sensitivity", "failures", "worst", "camera", "run", "scenario", "limits"),
}


def test_page_loads_nothing_from_outside(campaign):
    page = rendered_page(campaign)
    for tag, attributes in page.tags:
        for name in ("src", "href", "srcset", "data", "action"):
            value = attributes.get(name)
            assert value is None or value.startswith(("#", "data:image/png;base64,")), (tag, name)
    policies = [a["content"] for _, a in page.tags if a.get("http-equiv") == "Content-Security-Policy"]
    assert [str(policy).partition(";")[0] for policy in policies] == ["default-src 'none'"]


def test_page_has_every_section_with_an_explanation(campaign):
    page = rendered_page(campaign)
    assert {attributes["id"] for tag, attributes in page.tags if tag == "section"} == _SECTIONS
    links = {attributes["href"] for tag, attributes in page.tags if tag == "a"}
    assert links == {f"#{name}" for name in _SECTIONS}
    contents = [attributes["href"] for tag, attributes in page.tags if tag == "a"]
    assert contents[0] == "#outcome", "the outcome comes first"
    order = [attributes["id"] for tag, attributes in page.tags if tag == "section"]
    assert (order[0], order[-1]) == ("outcome", "identity")
    assert sum("how" in str(attributes.get("class")).split() for _, attributes in page.tags) >= len(_SECTIONS)


def test_every_chart_has_data_that_plotly_accepts(campaign):
    page = rendered_page(campaign)
    charts = json.loads(page.data)["charts"]
    placed = [str(attributes["data-chart"]) for _, attributes in page.tags if "data-chart" in attributes]
    assert set(placed) == set(charts)
    assert len(charts) > 15
    for chart in charts.values():
        plotly.graph_objects.Figure(chart)


def test_texts_of_the_scenario_are_escaped(campaign):
    campaign.drawn["<img src=http://x>"] = np.arange(40.0)
    campaign.failure_reason = np.where(np.arange(40) == 3, "<img src=http://y>", campaign.failure_reason)
    campaign.completed[3], campaign.failed_at_s[3], campaign.outcomes[3] = False, 10.0, "lost"
    text = write_report(campaign).read_text()
    assert "<script>alert(1)" not in text
    assert "<img src=http" not in text
    assert "<visible light>" not in text


def test_written_files(campaign):
    path = write_report(campaign)
    assert path == campaign.directory / "report.html"
    files = sorted(str(item.relative_to(path.parent)) for item in path.parent.rglob("*.*") if item.is_file())
    names = ("bearing_and_range", "estimation_error", "relative_position")
    assert files == [*(f"figures/{name}.png" for name in names), "report.html", "report.json"]
    json.loads((campaign.directory / "report.json").read_text(), parse_constant=pytest.fail)


def test_run_shown_in_detail_can_be_chosen(campaign):
    assert "Run 1 is the median one" in page_text(rendered_page(campaign, run_id=1))
    with pytest.raises(ResultError):
        write_report(campaign, run_id=35)


def test_unfinished_campaign_has_a_banner_with_the_resume_command(build):
    campaign = build(runs=12)
    assert "Unfinished" not in page_text(rendered_page(campaign))
    campaign.info["runs"] = 20
    page = rendered_page(campaign)
    words = page_text(page)
    head = words[: words.index("What was simulated")]
    assert "Unfinished campaign: 8 of 20 runs are missing" in head
    assert f"rpojax resume {campaign.directory}" in head
    assert any(attributes.get("class") == "banner" for _, attributes in page.tags)


def test_long_names_break_after_underscores(campaign):
    text = write_report(campaign).read_text()
    assert "<code>formation_<wbr>error_<wbr>rms_<wbr>m</code>" in text
    assert "<code>servicer.<wbr>mass_<wbr>kg</code>" in text


def test_folder_in_place_of_the_page_is_an_error(campaign):
    (campaign.directory / "report.html").mkdir(parents=True)
    with pytest.raises(OutputError, match=r"report\.html: found .*, expected a file") as caught:
        write_report(campaign)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kept", [(), (0, 1)])
def test_campaign_in_which_every_run_failed(build, kept):
    words = page_text(rendered_page(build(runs=60, failed=range(60), kept=kept)))
    assert "All 60 runs failed (95 %: 94 to 100 %): entered the keep-out sphere. No cause was found" in words
    assert "10 more are listed in report.json." in words
    assert ("No full history was kept" in words) == (not kept)


def test_campaign_without_traces_and_scenario(build):
    campaign = build(runs=3, kept=())
    campaign.drawn, campaign.traces, campaign.info = {}, {}, {"name": "bare"}
    words = page_text(rendered_page(campaign))
    for sentence in ("No trace over time", "Nothing was dispersed", "Needs at least ten runs", "holds no scenario"):
        assert sentence in words


def test_page_of_a_large_campaign_is_below_3_megabytes(build):
    path = write_report(build(runs=1000, seconds=3000, kept=(0, 1, 2, 3, 4, 5, 6, 7, 500)))
    assert path.stat().st_size < 3e6
