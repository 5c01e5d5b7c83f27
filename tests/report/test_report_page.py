"""The page: self-contained, well formed, and plain about what is missing."""

import ast
import inspect
import json
import re
from html.parser import HTMLParser

import numpy as np
import plotly.graph_objects
import pytest

from rpojax.campaign.rerun import rerun
from rpojax.errors import OutputError, ResultError
from rpojax.report.figures.plotly_charts import envelope_chart, histogram_bins, worst_run
from rpojax.report.labels import CHANNEL_LABELS, format_number
from rpojax.report.page import section_records
from rpojax.report.page.campaign_summary import summarise
from rpojax.report.page.html_report import write_report

_DASH = "\N{EN DASH}"
_VOID = {"meta", "img", "rect", "br", "wbr", "link"}
_SECTIONS = {
    *("identity", "requirements", "headline", "metrics", "safety", "envelopes", "consistency", "distributions"),
    *("convergence", "dispersions", "sensitivity", "failures", "worst", "camera", "run", "scenario", "limits"),
}


class Page(HTMLParser):
    """Collects tags, text and data of a page, and checks that elements close in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.data = ""
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in _VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "script" not in self.open:
            self.text.append(data)
        elif self.tags[-1][1].get("id") == "page-data":
            self.data += data


def _page(campaign, run_id=None):
    return Page(write_report(campaign, run_id).read_text())


def _words(page):
    return re.sub(r"\s+", " ", " ".join(page.text))


def test_page_loads_nothing_from_outside(campaign):
    page = _page(campaign)
    for tag, attributes in page.tags:
        for name in ("src", "href", "srcset", "data", "action"):
            value = attributes.get(name)
            assert value is None or value.startswith(("#", "data:image/png;base64,")), (tag, name)
    policies = [a["content"] for _, a in page.tags if a.get("http-equiv") == "Content-Security-Policy"]
    assert [str(policy).partition(";")[0] for policy in policies] == ["default-src 'none'"]


def test_page_has_every_section_each_with_an_explanation_or_a_plain_word(campaign):
    page = _page(campaign)
    assert {attributes["id"] for tag, attributes in page.tags if tag == "section"} == _SECTIONS
    links = {attributes["href"] for tag, attributes in page.tags if tag == "a"}
    assert links == {f"#{name}" for name in _SECTIONS}
    assert sum(attributes.get("class") == "how" for _, attributes in page.tags) == len(_SECTIONS)


def test_every_chart_has_data_that_plotly_accepts(campaign):
    page = _page(campaign)
    charts = json.loads(page.data)["charts"]
    placed = [str(attributes["data-chart"]) for _, attributes in page.tags if "data-chart" in attributes]
    assert sorted(placed) == sorted(charts)
    assert len(charts) > 15
    for chart in charts.values():
        plotly.graph_objects.Figure(chart)


def test_text_from_the_scenario_cannot_become_markup(campaign):
    campaign.drawn["<img src=http://x>"] = np.arange(40.0)
    campaign.failure_reason = np.where(np.arange(40) == 3, "<img src=http://y>", campaign.failure_reason)
    campaign.completed[3], campaign.failed_at_s[3] = False, 10.0
    text = write_report(campaign).read_text()
    assert "<script>alert(1)" not in text
    assert "<img src=http" not in text
    assert "<visible light>" not in text


def test_folder_gets_page_json_and_figures_and_no_leftovers(campaign):
    path = write_report(campaign)
    assert path == campaign.directory / "report.html"
    files = sorted(str(item.relative_to(path.parent)) for item in path.parent.rglob("*.*") if item.is_file())
    names = ("bearing_and_range", "estimation_error", "relative_position")
    assert files == [*(f"figures/{name}.png" for name in names), "report.html", "report.json"]
    json.loads((campaign.directory / "report.json").read_text(), parse_constant=pytest.fail)


def test_chosen_run_can_be_overridden(campaign):
    assert "Run 1." in _words(_page(campaign, run_id=1))
    with pytest.raises(ResultError):
        write_report(campaign, run_id=35)


def test_a_report_of_an_unfinished_campaign_says_so_at_its_head_and_how_to_go_on(build):
    campaign = build(runs=12)
    assert "Unfinished" not in _words(_page(campaign))
    campaign.info["runs"] = 20
    page = _page(campaign)
    words = _words(page)
    head = words[: words.index("What was run.")]
    assert "Unfinished campaign: 8 of 20 runs are missing" in head
    assert f"rpojax resume {campaign.directory}" in head
    assert any(attributes.get("class") == "banner" for _, attributes in page.tags)


def test_the_command_that_flies_a_run_again_names_the_campaigns_folder(build):
    campaign = build(runs=12, failed=(4,))
    command = f"rpojax rerun {campaign.directory} --run-id"
    words = _words(_page(campaign))
    assert f"Any run again {command} I --out DIR" in words
    assert f"{command} 4 --out run_4" in words


def test_replaced_stages_are_part_of_the_identity_and_have_to_be_given_to_fly_a_run_again(build):
    campaign = build(runs=12, failed=(4,))
    campaign.info["stages"] = {"formation_law": {"function": "mine.pd_law", "source_sha256": "ab" * 32}}
    words = _words(_page(campaign))
    assert f"Replaced stages formation_law = mine.pd_law, source {'ab' * 32}" in words
    assert "rpojax rerun " not in words
    found = f"rpojax.Campaign({str(campaign.directory)!r})"
    command = f"rpojax.campaign.rerun.rerun({found}, 4, pathlib.Path('run_4'), stages=...)"
    assert command in words
    call = ast.parse(command, mode="eval").body
    assert isinstance(call, ast.Call)
    inspect.signature(rerun).bind(*call.args, **{str(word.arg): word.value for word in call.keywords})


def test_where_low_is_bad_the_low_side_is_shown(campaign):
    campaign.metrics["min_range_m"] = np.linspace(20.0, 30.0, 40)
    rows = {row.name: row for row in section_records.metric_rows(campaign, summarise(campaign))}
    assert rows["min_range_m"].cells[4:7] == ["p5 20.50", "p1 20.10", f"p1 {_DASH}"]
    assert not any("p" in cell for cell in rows["delta_v_m_s"].cells)
    shown = {entry["name"]: entry for entry in section_records.histogram_entries(campaign, summarise(campaign))}
    assert shown["min_range_m"]["tail"] == "p1 20.10"
    assert shown["min_range_m"]["chart"]["layout"]["shapes"][1]["x0"] == pytest.approx(20.1)
    assert shown["delta_v_m_s"]["tail"].startswith("p99 ")


def test_names_break_after_underscores_only(campaign):
    text = write_report(campaign).read_text()
    assert "<code>formation_<wbr>error_<wbr>rms_<wbr>m</code>" in text
    assert "<code>servicer.<wbr>mass_<wbr>kg</code>" in text


def test_the_sensitivity_opens_on_the_formation_error_and_shares_are_plain_decimals(campaign):
    campaign.metrics = dict(sorted(campaign.metrics.items()))
    data = json.loads(_page(campaign).data)
    assert next(iter(data["explorer"]["metrics"])) == "formation_error_rms_m"
    axis = data["charts"]["histogram-good_boxes_rejected_fraction"]["layout"]["xaxis"]
    assert axis["exponentformat"] == "none"


def test_what_varies_is_said_in_full(build):
    campaign = build(runs=3, kept=())
    words = _words(_page(campaign))
    for cause in ("Dispersions", "hand-over", "execution errors of burns", "slowly varying errors"):
        assert cause in words.partition("From run to run vary")[2][:250]
    campaign.drawn = {}
    assert "the runs differ by the error of the hand-over" in _words(_page(campaign))


def test_a_folder_in_place_of_the_page_is_refused_in_one_line(campaign):
    (campaign.directory / "report.html").mkdir(parents=True)
    with pytest.raises(OutputError, match=r"report\.html: found .*, expected a file") as caught:
        write_report(campaign)
    assert "\n" not in str(caught.value)


def test_campaign_of_one_run(build):
    words = _words(_page(build(runs=1, kept=(0,))))
    assert "One run has no distribution" in words
    assert "None failed." in words
    assert "Run 0." in words


@pytest.mark.parametrize("kept", [(), (0, 1)])
def test_campaign_in_which_every_run_failed(build, kept):
    words = _words(_page(build(runs=60, failed=range(60), kept=kept)))
    assert "60 of 60 runs failed: 60 \N{MULTIPLICATION SIGN} entered the keep-out sphere." in words
    assert "10 more are listed in report.json." in words
    assert ("No full history was kept" in words) == (not kept)


def test_bare_campaign_says_plainly_what_is_missing(build):
    campaign = build(runs=3, kept=())
    campaign.drawn, campaign.traces, campaign.info = {}, {}, {"name": "bare"}
    words = _words(_page(campaign))
    for sentence in ("No trace over time", "Nothing was dispersed", "Needs at least ten runs", "holds no scenario"):
        assert sentence in words


def test_boxes_are_counted_where_histories_hold_scores_and_outlines(campaign):
    words = _words(_page(campaign))
    assert "No history holds scores and true outlines" in words
    for history in campaign.histories.values():
        history["box_score"] = np.where(history["box_present"], 1.0, 0.0)
        history["outline_px"] = history["box_px"]
    page = _page(campaign)
    assert "False per look-away frame" in _words(page)
    assert "A box without a detector has the score 1" in _words(page)
    content = json.loads((campaign.directory / "report.json").read_text())
    assert content["detections"][0]["edges"]["overlap"] == pytest.approx(1.0)


def test_pictures_that_cannot_be_taken_again_are_explained(campaign):
    campaign.info["scenario"]["camera"]["model"] = "rendered"
    assert "The pictures cannot be taken again: " in _words(_page(campaign))
    write_report(campaign, film=False)
    assert "It was left out by --no-film." in _words(Page((campaign.directory / "report.html").read_text()))


def test_page_of_a_large_campaign_stays_small(build):
    path = write_report(build(runs=1000, seconds=3000, kept=(0,)))
    assert path.stat().st_size < 8e6


def test_envelope_bands_hold_the_stated_shares():
    values = np.random.default_rng(5).uniform(1.0, 2.0, (2000, 50))
    chart = envelope_chart(CHANNEL_LABELS[0], np.arange(50.0), values, np.ones(2000, bool))
    assert chart is not None
    low, high = (np.array(trace["y"]) for trace in chart["data"][2:4])
    share = np.mean((values >= low) & (values <= high))
    assert share == pytest.approx(0.90, abs=0.005)


@pytest.mark.parametrize(
    ("runs", "names"), [(1, set()), (19, {"smallest to largest"}), (99, {"smallest to largest", "5\N{EN DASH}95 %"})]
)
def test_bands_that_too_few_runs_cannot_resolve_are_not_drawn(runs, names):
    values = np.random.default_rng(6).uniform(1.0, 2.0, (runs, 50))
    chart = envelope_chart(CHANNEL_LABELS[0], np.arange(50.0), values, np.ones(runs, bool))
    assert chart is not None
    assert {trace["legendgroup"] for trace in chart["data"] if "legendgroup" in trace} == names


def test_worst_run_is_completed_and_low_range_is_the_bad_side():
    error, distance = CHANNEL_LABELS[0], CHANNEL_LABELS[2]
    values = np.array([[9.0, 1.0, 1.0], [0.0, 3.0, 3.0], [5.0, 8.0, np.nan]])
    completed = np.array([True, True, False])
    assert worst_run(error, values, completed) == 1
    assert worst_run(distance, values, completed) == 1
    assert worst_run(error, values, ~completed & False) is None


@pytest.mark.parametrize("values", [[0.0], [0.3, 0.3 + 1e-16, 0.3], [1.0, 2.0, 5.0], [-1e9, 1e9], [1e-9, 2e-9]])
def test_every_value_falls_into_a_bin(values):
    counts, edges = histogram_bins(np.array(values))
    assert counts.sum() == len(values)
    assert len(edges) == len(counts) + 1
    assert len(counts) <= 37


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, _DASH),
        (np.nan, _DASH),
        (0.0, "0"),
        (12.0, "12"),
        (0.41953, "0.4195"),
        (12345.678, "12346"),
        (2.5e-6, "0.000002500"),
        (3.2e-7, "3.200e-07"),
    ],
)
def test_numbers_have_four_significant_digits(value, text):
    assert format_number(value) == text
