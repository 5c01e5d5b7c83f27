"""The page of one run: what happened over time, and no statistics of a single value."""

import json
import re

import plotly.graph_objects
from report_page_parser import page_text, rendered_page

_SECTIONS = ["outcome", "playback", "timeline", "camera", "estimation", "burns", "safety", "metrics", "drawn", "limits"]
REQUIREMENTS = [
    {"metric": "delta_v_m_s", "bound": "at most", "limit": 0.5, "probability": 0.99, "consumer_risk": 0.1},
    {"metric": "min_range_m", "bound": "at least", "limit": 50.0, "probability": 0.99, "consumer_risk": 0.1},
]


def one_run(build, **choices):
    campaign = build(runs=1, kept=(0,), **choices)
    campaign.info["scenario"]["requirements"] = REQUIREMENTS
    return campaign


def test_one_run_has_a_page_of_its_own_without_percentiles(build):
    page = rendered_page(one_run(build))
    sections = [attributes["id"] for tag, attributes in page.tags if tag == "section"]
    assert sections == [*_SECTIONS, "scenario", "identity"]
    words = page_text(page).partition("}")[2]
    body = words[words.index("Report of one run") :]
    assert not re.search(r"\bp(?:1|5|50|95|99)\b(?! )|percentile|more runs|median run", body)
    assert "The run completed; 1 of 2 limits of requirements kept" in body


def test_every_chart_is_placed_and_accepted_by_plotly(build):
    page = rendered_page(one_run(build))
    charts = json.loads(page.data)["charts"]
    placed = [str(attributes["data-chart"]) for _, attributes in page.tags if "data-chart" in attributes]
    assert sorted(placed) == sorted(charts)
    shown = {"0-range_m", "0-error-relative-0", "0-wheel_speed_fraction", "0-box-range", "0-delta_v_m_s"}
    assert shown <= charts.keys()
    for chart in charts.values():
        plotly.graph_objects.Figure(chart)


def test_tiles_state_value_and_margin_of_each_limit_the_broken_one_first(build):
    campaign = one_run(build)
    page = rendered_page(campaign)
    tiles = [str(a["class"]) for _, a in page.tags if str(a.get("class")).startswith("tile ")]
    assert tiles == ["tile alert", "tile good"]
    margin = campaign.metrics["min_range_m"][0] - 50.0
    assert f"margin \N{MINUS SIGN}{abs(margin):.1f} m" in page_text(page)


def test_failed_run_says_when_and_why(build):
    words = page_text(rendered_page(one_run(build, failed=(0,))))
    assert "The run failed: entered the keep-out sphere, since 300 s" in words
    assert "failed: entered the keep-out sphere" in words[words.index("Rest the pointer") :]


def test_run_without_a_history_says_so(build):
    campaign = build(runs=1, kept=())
    words = page_text(rendered_page(campaign))
    assert "No full history was kept, so the run is not shown over time." in words


def test_repeated_run_names_its_campaign(build):
    campaign = one_run(build)
    campaign.info["rerun_of"] = {"first_run": 0, "runs": 200}
    assert "repeated from a campaign of 200 runs" in page_text(rendered_page(campaign))
